//! What each condition costs, part by part: the executed drive's scores and the eight terms, each as a paired difference to
//! the same scenarios on a clear, dry day. All of it is exploratory: nothing here is tested.

use ds_score::Term;

use super::rows::{Anchor, INTERVALS, TERM_HEADINGS, mean_of, named};
use super::studies::{axes, changed};
use super::{SCORES, gate};
use crate::estimate::Bootstrap;
use crate::judge::PROFILES;
use crate::manifest::{Entry, Kind, Manifest};
use crate::results::{Drive, Results};
use crate::sheet::Arm;
use crate::table::{EstimateStyle, Table, Value};

/// Returns the differences of scores and terms to the base, by condition.
pub(super) fn conditions(results: &Results, anchor: Anchor, bootstrap: &mut Bootstrap) -> Table {
    let mut rows = Vec::new();
    for set in results.sets.iter().filter(|set| set.kind == Kind::Weather) {
        for arm in results.sheet.arms() {
            for profile in PROFILES {
                for (axis, name, conditions) in axes() {
                    let these = |entry: &&Entry| conditions.contains(&entry.appearance.as_str());
                    let entries: Vec<&Entry> = set.entries.iter().filter(these).collect();
                    let mut row = head(anchor, set, &arm, [profile, axis, name]);
                    row.extend(parts(results, &arm, profile, &entries, bootstrap));
                    row.push(Value::text(gate::fault(results, &arm, &entries).unwrap_or("no objection")));
                    rows.push(row);
                }
            }
        }
    }
    let mut columns = vec!["policy", "set", "how", "profile", "axis", "condition"];
    columns.extend(SCORES.map(|(name, _)| name).into_iter().chain(TERM_HEADINGS).chain(["gate"]));
    let note = format!(
        "Difference of scores and terms to the same scenarios on a clear, dry day, in points; of a term over the scenarios in \
         which it applies by day and under the condition. Nothing is tested here, and a row whose gate objects supports no \
         claim. {INTERVALS}"
    );
    Table { id: "conditions", title: "Conditions, part by part", note, columns, rows }
}

fn head(anchor: Anchor, set: &Manifest, arm: &Arm, words: [&str; 3]) -> Vec<Value> {
    let mut row = named(anchor, set, arm);
    row.extend(words.map(Value::text));
    row
}

/// Returns the difference of every score and term.
fn parts(
    results: &Results,
    arm: &Arm,
    profile: &'static str,
    entries: &[&Entry],
    bootstrap: &mut Bootstrap,
) -> Vec<Value> {
    let mut difference = |value: &dyn Fn(&Drive) -> Option<f64>| {
        let (_, differences) = changed(results, arm, entries, value);
        Value::Estimate(bootstrap.estimate(&differences), EstimateStyle::Signed)
    };
    let mut values = SCORES.map(|(_, score)| difference(&|drive: &Drive| drive.score(profile, score))).to_vec();
    values.extend(Term::ALL.map(|term| difference(&mean_of(term.name(), profile))));
    values
}

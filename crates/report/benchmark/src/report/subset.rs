//! The scenarios on which a policy scores high: how far it falls there under each condition, and how far by itself.
//!
//! Who is picked for a high score was lucky too and falls when driven again. So seeds that select are apart from those
//! that are reported; the original is driven anew like every condition, and its own fall is a row.

use std::collections::BTreeSet;

use super::gate;
use super::rows::{Anchor, INTERVALS, TESTED, behind, corrected, driving_score, named, tested_behind};
use super::studies::{axes, changed};
use crate::estimate::{Bootstrap, Difference, Unit};
use crate::judge::PROFILES;
use crate::manifest::{Entry, Kind, Manifest};
use crate::results::{Results, unit};
use crate::sheet::Arm;
use crate::table::{EstimateStyle, Table, Value};

/// From this driving score on, over the selection seeds, a scenario is of the subset.
const HIGH: f64 = 0.8;

/// One row before it is corrected: axis, condition, what forbids a claim, DS on the report seeds, difference.
struct Row {
    words: [&'static str; 2],
    fault: Option<&'static str>,
    shown: Vec<Unit>,
    found: Difference,
}

/// Returns what the subset scores; nothing where nothing was driven on selection seeds.
pub(super) fn subset(results: &Results, anchor: Anchor, bootstrap: &mut Bootstrap) -> Table {
    let mut rows = Vec::new();
    for set in results.sets.iter().filter(|set| set.kind == Kind::Base && !results.sheet.selection.is_empty()) {
        for arm in results.sheet.arms() {
            for profile in PROFILES {
                let members = members(results, &arm, set, profile);
                if members.is_empty() {
                    continue;
                }
                let fixed = members.iter().filter(|entry| unmoved(results, &arm, entry, profile)).count();
                let found = of(results, &arm, &members, profile, bootstrap);
                let holm = corrected(found.iter().map(|row| &row.found));
                for (Row { words, fault, shown, found }, p_holm) in found.into_iter().zip(holm) {
                    let mut row = named(anchor, set, &arm);
                    row.extend([Value::text(profile), Value::count(members.len()), Value::count(fixed)]);
                    row.extend(words.map(Value::text));
                    row.push(Value::Estimate(bootstrap.estimate(&shown), EstimateStyle::Points));
                    row.extend(tested_behind(fault, &found, p_holm));
                    rows.push(row);
                }
            }
        }
    }
    let mut columns = vec!["policy", "set", "how", "profile", "members", "seedless", "axis", "condition", "DS"];
    columns.extend(TESTED);
    let note = format!(
        "Scenarios with DS ≥ 80 over the selection seeds {:?}; all else is of the report seeds. Original: the same \
         scenarios driven anew, and their own fall since the selection, which is luck that does not come twice. Conditions: \
         difference to the original driven anew. Seedless: members whose drives are equal on every seed, which cannot fall \
         by themselves. Holm over the rows of a policy and profile. {INTERVALS}",
        results.sheet.selection
    );
    Table { id: "subset", title: "High-score subset", note, columns, rows }
}

/// Returns the entries that score high over the selection seeds.
fn members<'a>(results: &Results, arm: &Arm, set: &'a Manifest, profile: &'static str) -> Vec<&'a Entry> {
    let high = |entry: &&Entry| selected(results, arm, entry, profile).is_some_and(|score| score >= HIGH);
    set.entries.iter().filter(high).collect()
}

/// Returns the mean driving score over the selection seeds.
fn selected(results: &Results, arm: &Arm, entry: &Entry, profile: &'static str) -> Option<f64> {
    ds_stats::mean(results.selecting(arm, entry).into_iter().filter_map(driving_score(profile)))
}

/// Says whether the drives of an entry score the same on every seed.
fn unmoved(results: &Results, arm: &Arm, entry: &Entry, profile: &'static str) -> bool {
    let all = results.selecting(arm, entry).into_iter().chain(results.of(arm, entry));
    let scores: BTreeSet<Option<u64>> = all.map(driving_score(profile)).map(|score| score.map(f64::to_bits)).collect();
    scores.len() == 1
}

/// Returns the original's own fall and the difference of each condition to it.
fn of(results: &Results, arm: &Arm, members: &[&Entry], profile: &'static str, bootstrap: &mut Bootstrap) -> Vec<Row> {
    let score = driving_score(profile);
    let anew = |entry: &Entry| results.mean(arm, entry, &score);
    let shown = members.iter().filter_map(|entry| Some(unit(entry, anew(entry)?, 1.0))).collect();
    let fall = |entry: &&Entry| Some(unit(entry, anew(entry)? - selected(results, arm, entry, profile)?, 1.0));
    let falls: Vec<Unit> = members.iter().filter_map(fall).collect();
    let words = ["original", "own fall"];
    let mut rows = vec![Row { words, fault: None, shown, found: bootstrap.difference(&falls) }];
    let names: BTreeSet<&str> = members.iter().map(|entry| entry.name.as_str()).collect();
    let weather = results.sets.iter().filter(|set| set.kind == Kind::Weather).flat_map(|set| &set.entries);
    let theirs: Vec<&Entry> =
        weather.filter(|entry| entry.base.as_deref().is_some_and(|base| names.contains(base))).collect();
    for (axis, name, conditions) in axes() {
        let these: Vec<&Entry> =
            theirs.iter().filter(|entry| conditions.contains(&entry.appearance.as_str())).copied().collect();
        if !these.is_empty() {
            let (shown, differences) = changed(results, arm, &these, &score);
            let fault = gate::fault(results, arm, &these);
            let found = behind(fault, bootstrap.difference(&differences));
            rows.push(Row { words: [axis, name], fault, shown, found });
        }
    }
    rows
}

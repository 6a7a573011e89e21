//! Contacts against adversaries and on each variant's own base: what the adversary adds, by policy; and the bar that whoever sees
//! no truth is hit more often and scores less.

use std::collections::BTreeMap;

use super::rows::{Anchor, INTERVALS, NO_BASE, TESTED, behind, corrected, driving_score, named, tested_behind};
use super::studies::changed;
use crate::estimate::{Bootstrap, Difference, Estimate, Unit};
use crate::judge::PROFILES;
use crate::manifest::{Entry, Kind, Manifest};
use crate::results::Results;
use crate::sheet::Arm;
use crate::table::{EstimateStyle, Table, Value};

/// What an arm meets on a set and on its base.
struct Found {
    arm: Arm,
    fault: Option<&'static str>,
    /// Shares of drives with a contact, on the variants and on their bases.
    shares: [Estimate; 2],
    contacts: Difference,
    /// Differences of the driving score, by profile.
    scores: [Estimate; 2],
}

/// Returns contacts against adversaries minus those of the base, by arm.
pub(super) fn contacts(results: &Results, anchor: Anchor, bootstrap: &mut Bootstrap) -> Table {
    let mut rows = Vec::new();
    for set in results.sets.iter().filter(|set| set.kind == Kind::Behavior) {
        let found: Vec<Found> =
            results.sheet.arms().into_iter().map(|arm| compared(results, arm, set, bootstrap)).collect();
        let holm = corrected(found.iter().map(|found| &found.contacts));
        for (Found { arm, fault, shares, contacts, scores }, p_holm) in found.into_iter().zip(holm) {
            let mut row = named(anchor, set, &arm);
            row.extend(shares.map(|share| Value::Estimate(share, EstimateStyle::Points)));
            row.extend(tested_behind(fault, &contacts, p_holm));
            row.extend(scores.map(|score| Value::Estimate(score, EstimateStyle::Signed)));
            row.push(Value::text(if anchor(&arm.policy.name) { "none" } else { bar(&contacts.estimate, &scores) }));
            rows.push(row);
        }
    }
    let mut columns = vec!["policy", "set", "how", "contact", "contact base"];
    columns.extend(TESTED);
    columns.extend(["DS bridgesim", "DS strict", "bar"]);
    let note = format!(
        "Share of drives with a contact, on variants and on their own bases, and the paired difference; beside it that of DS. \
         Bar, of policies that are no anchors: more contacts and less DS in both profiles, the intervals by scenario and by log \
         clear of 0. Holm over the rows of a set. {INTERVALS}"
    );
    Table { id: "contacts", title: "Contacts against adversaries", note, columns, rows }
}

fn compared(results: &Results, arm: Arm, set: &Manifest, bootstrap: &mut Bootstrap) -> Found {
    let entries: Vec<&Entry> = set.entries.iter().collect();
    let (shown, differences) = changed(results, &arm, &entries, &|drive| drive.happened(|outcome| outcome.contact));
    let fault = (differences.is_empty() && !shown.is_empty()).then_some(NO_BASE);
    let scores = PROFILES.map(|profile| {
        let (_, differences) = changed(results, &arm, &entries, &driving_score(profile));
        bootstrap.estimate(&differences)
    });
    let shares = [bootstrap.share(&shown), bootstrap.share(&before(&shown, &differences))];
    Found { fault, shares, contacts: behind(fault, bootstrap.difference(&differences)), scores, arm }
}

/// Returns what the bases had of which variants differ so far.
fn before(shown: &[Unit], differences: &[Unit]) -> Vec<Unit> {
    let shown: BTreeMap<&str, f64> = shown.iter().map(|unit| (unit.scenario.as_str(), unit.above)).collect();
    let one = |unit: &Unit| Some(Unit { above: shown.get(unit.scenario.as_str())? - unit.above, ..unit.clone() });
    differences.iter().filter_map(one).collect()
}

fn bar(contacts: &Estimate, scores: &[Estimate]) -> &'static str {
    let beyond = |estimate: &Estimate, clear: fn([f64; 2]) -> bool| -> Option<bool> {
        Some(clear(estimate.by_scenario?) && clear(estimate.by_log?))
    };
    let all = [beyond(contacts, |[low, _]| low > 0.0)]
        .into_iter()
        .chain(scores.iter().map(|score| beyond(score, |[_, high]| high < 0.0)));
    match all.collect::<Option<Vec<bool>>>() {
        None => "not measured",
        Some(clear) if clear.iter().all(|clear| *clear) => "met",
        Some(_) => "missed",
    }
}

//! The endpoints that were declared before the run: each as a paired difference, corrected together.

use std::collections::BTreeMap;

use ds_stats::mean;

use super::gate;
use super::rows::{INTERVALS, NO_BASE, TESTED, behind, corrected, driving_score, how, tested_behind};
use super::studies::{by_base, changed, paired};
use crate::endpoint::{Claim, Direction, Endpoint, LEARNED};
use crate::estimate::{Bootstrap, Difference, Unit};
use crate::judge::PROFILES;
use crate::manifest::{Entry, Kind, Manifest};
use crate::results::{Results, unit};
use crate::sheet::Arm;
use crate::source::CONDITIONS;
use crate::table::{EstimateStyle, Table, Value};

/// Why an endpoint is not tested whose policies were not driven.
const UNDRIVEN: &str = "not tested: not driven";

/// Returns the declared endpoints; a table without rows where none was.
pub(super) fn endpoints(results: &Results, bootstrap: &mut Bootstrap) -> Table {
    let found: Vec<(&Endpoint, Compared, Difference)> = results
        .sheet
        .endpoints
        .iter()
        .flat_map(|endpoint| compared(results, endpoint).into_iter().map(move |compared| (endpoint, compared)))
        .map(|(endpoint, compared)| {
            let found = behind(compared.fault, bootstrap.difference(&compared.units));
            (endpoint, compared, found)
        })
        .collect();
    let holm = corrected(found.iter().map(|(.., found)| found));
    let mut rows = Vec::new();
    for ((endpoint, Compared { arm, sides, fault, .. }, found), p_holm) in found.into_iter().zip(holm) {
        let claimed = match endpoint.direction {
            Direction::Up => "above 0",
            Direction::Down => "below 0",
        };
        let mut row = [&endpoint.name, &told(&endpoint.claim), &arm, &endpoint.profile].map(Value::text).to_vec();
        row.push(Value::text(claimed));
        row.extend(sides.each_ref().map(|side| Value::Estimate(bootstrap.share(side), EstimateStyle::Points)));
        row.push(Value::Estimate(bootstrap.estimate(&quotients(&sides)), EstimateStyle::Rate));
        row.extend(tested_behind(fault, &found, p_holm));
        row.push(Value::text(conclusion(endpoint.direction, &found, p_holm)));
        rows.push(row);
    }
    let mut columns = vec!["endpoint", "what", "how", "profile", "claim", "first", "second", "ratio"];
    columns.extend(TESTED);
    columns.push("conclusion");
    let note = format!(
        "Declared before the run and kept with the results, a row for each way in which it was driven; Holm over these rows \
         alone. First, second and ratio, second ÷ first: shares of drives with a contact, over the base scenarios of both \
         sets. {INTERVALS}"
    );
    Table { id: "endpoints", title: "Endpoints", note, columns, rows }
}

fn told(claim: &Claim) -> String {
    match claim {
        Claim::Policies { first, second } => format!("{second} − {first}"),
        Claim::Axes { policy, first, second } => format!("{policy}: {second} − {first}"),
        Claim::Contacts { policy, first, second } => format!("{policy}: contacts on {second} − on {first}"),
        Claim::Coverage { policy } => format!("{policy}: adversaries − base"),
    }
}

fn conclusion(direction: Direction, found: &Difference, p_holm: Option<f64>) -> &'static str {
    let up = found.estimate.value.is_some_and(|value| value > 0.0);
    match (p_holm, up == (direction == Direction::Up)) {
        (None, _) => "not tested",
        (Some(p), true) if p <= super::rows::LEVEL => "as claimed",
        (Some(p), false) if p <= super::rows::LEVEL => "the other way",
        _ => "not found",
    }
}

/// How an endpoint was driven, its paired differences, what is compared where that is shares, and what forbids a claim.
#[derive(Default)]
struct Compared {
    arm: String,
    units: Vec<Unit>,
    sides: [Vec<Unit>; 2],
    fault: Option<&'static str>,
}

/// Returns what an endpoint compares, one for each way in which its policy was driven.
fn compared(results: &Results, endpoint: &Endpoint) -> Vec<Compared> {
    let Some(profile) = PROFILES.into_iter().find(|profile| *profile == endpoint.profile) else { return Vec::new() };
    let (policy, oracle) = match &endpoint.claim {
        Claim::Policies { second, .. } => (second, false),
        Claim::Axes { policy, .. } | Claim::Contacts { policy, .. } => (policy, false),
        Claim::Coverage { policy } => (policy, true),
    };
    let fits = |arm: &Arm| arm.policy.name == *policy && (arm.scorer != LEARNED) == oracle;
    let arms: Vec<Arm> = results.sheet.arms().into_iter().filter(fits).collect();
    if arms.is_empty() {
        return vec![Compared { fault: Some(UNDRIVEN), ..Compared::default() }];
    }
    arms.iter().map(|arm| Compared { arm: how(arm), ..of_arm(results, &endpoint.claim, profile, arm) }).collect()
}

/// Returns what a claim compares for an arm of its policy.
fn of_arm(results: &Results, claim: &Claim, profile: &'static str, arm: &Arm) -> Compared {
    let sets = |kind: Kind| results.sets.iter().filter(move |set| set.kind == kind);
    match claim {
        Claim::Policies { first, .. } => {
            let Some(policy) = results.sheet.policies.iter().find(|policy| policy.name == *first) else {
                return Compared { fault: Some(UNDRIVEN), ..Compared::default() };
            };
            let before = Arm { policy: policy.clone(), ..arm.clone() };
            let all = sets(Kind::Base).flat_map(|set| paired(results, set, [&before, arm], &driving_score(profile)));
            Compared { units: all.collect(), ..Compared::default() }
        }
        Claim::Coverage { .. } => {
            let entries: Vec<&Entry> = sets(Kind::Behavior).flat_map(|set| &set.entries).collect();
            let units = changed(results, arm, &entries, &driving_score(profile)).1;
            Compared { fault: units.is_empty().then_some(NO_BASE), units, ..Compared::default() }
        }
        Claim::Contacts { first, second, .. } => contacts(results, arm, [first, second]),
        Claim::Axes { first, second, .. } => {
            let weather: Vec<&Manifest> = sets(Kind::Weather).collect();
            let [first, second] = [first, second].map(|axis| of_axis(&weather, axis));
            let fault = gate::fault(results, arm, &[first.clone(), second.clone()].concat());
            let [a, b] = [first, second].map(|entries| by_scenario(results, arm, profile, &entries));
            let both = b.into_iter().filter_map(|(name, unit)| {
                let before = a.get(&name)?;
                Some(Unit { above: unit.above - before.above, ..unit })
            });
            let units: Vec<Unit> = both.collect();
            Compared { fault: fault.or(units.is_empty().then_some(NO_BASE)), units, ..Compared::default() }
        }
    }
}

/// Returns the contacts of an arm on two sets, paired by base scenario.
fn contacts(results: &Results, arm: &Arm, sets: [&String; 2]) -> Compared {
    let [before, after] = sets.map(|name| {
        let entries = results.sets.iter().filter(|set| set.name == *name).flat_map(|set| &set.entries);
        by_base(results, arm, entries, &|drive| drive.happened(|outcome| outcome.contact))
    });
    let mut compared = Compared::default();
    for (base, (entry, after)) in after {
        let Some([first, second]) =
            before.get(base).and_then(|(_, before)| Some([mean(before.iter().copied())?, mean(after)?]))
        else {
            continue;
        };
        compared.units.push(unit(entry, second - first, 1.0));
        compared.sides[0].push(unit(entry, first, 1.0));
        compared.sides[1].push(unit(entry, second, 1.0));
    }
    compared
}

/// Returns the second side over the first.
fn quotients([first, second]: &[Vec<Unit>; 2]) -> Vec<Unit> {
    first.iter().zip(second).map(|(first, second)| Unit { below: first.above, ..second.clone() }).collect()
}

/// Returns the entries under the conditions of an axis.
fn of_axis<'a>(weather: &[&'a Manifest], axis: &str) -> Vec<&'a Entry> {
    let conditions: Vec<&str> =
        CONDITIONS.iter().filter(|(name, _)| *name == axis).flat_map(|(_, names)| names.iter().copied()).collect();
    let these = |entry: &&Entry| conditions.contains(&entry.appearance.as_str());
    weather.iter().flat_map(|set| &set.entries).filter(these).collect()
}

/// Returns the mean difference to the base of each scenario over some of its conditions.
fn by_scenario(results: &Results, arm: &Arm, profile: &'static str, entries: &[&Entry]) -> BTreeMap<String, Unit> {
    let units = changed(results, arm, entries, &driving_score(profile)).1;
    units.into_iter().map(|unit| (unit.scenario.clone(), unit)).collect()
}

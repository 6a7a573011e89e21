//! The endpoints that were declared before the run: each as a paired difference, corrected together.

use std::collections::BTreeMap;

use super::gate;
use super::rows::{INTERVALS, TESTED, behind, corrected, driving_score, how, tested_behind};
use super::studies::{changed, paired};
use crate::endpoint::{Claim, Direction, Endpoint};
use crate::estimate::{Bootstrap, Difference, Unit};
use crate::judge::PROFILES;
use crate::manifest::{Entry, Kind, Manifest};
use crate::results::Results;
use crate::sheet::Arm;
use crate::source::CONDITIONS;
use crate::table::{Table, Value};

/// Returns the declared endpoints; a table without rows where none was.
pub(super) fn endpoints(results: &Results, bootstrap: &mut Bootstrap) -> Table {
    let found: Vec<(&Endpoint, Compared, Difference)> = results
        .sheet
        .endpoints
        .iter()
        .map(|endpoint| {
            let compared = compared(results, endpoint).unwrap_or_default();
            let found = behind(compared.fault, bootstrap.difference(&compared.units));
            (endpoint, compared, found)
        })
        .collect();
    let holm = corrected(found.iter().map(|(.., found)| found));
    let mut rows = Vec::new();
    for ((endpoint, Compared { arm, fault, .. }, found), p_holm) in found.into_iter().zip(holm) {
        let claimed = match endpoint.direction {
            Direction::Up => "above 0",
            Direction::Down => "below 0",
        };
        let mut row = [&endpoint.name, &told(&endpoint.claim), &arm, &endpoint.profile].map(Value::text).to_vec();
        row.push(Value::text(claimed));
        row.extend(tested_behind(fault, &found, p_holm));
        row.push(Value::text(conclusion(endpoint.direction, &found, p_holm)));
        rows.push(row);
    }
    let mut columns = vec!["endpoint", "what", "how", "profile", "claim"];
    columns.extend(TESTED);
    columns.push("conclusion");
    let note = format!(
        "Declared before the run and kept with the results; Holm over these rows alone. An endpoint whose policy or sets were \
         not driven is not tested. {INTERVALS}"
    );
    Table { id: "endpoints", title: "Endpoints", note, columns, rows }
}

fn told(claim: &Claim) -> String {
    match claim {
        Claim::Policies { first, second } => format!("{second} − {first}"),
        Claim::Axes { policy, first, second } => format!("{policy}: {second} − {first}"),
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

/// How an endpoint was driven, its paired differences, and what forbids a claim.
#[derive(Default)]
struct Compared {
    arm: String,
    units: Vec<Unit>,
    fault: Option<&'static str>,
}

/// Returns what an endpoint compares; nothing where it was not driven.
fn compared(results: &Results, endpoint: &Endpoint) -> Option<Compared> {
    let profile = PROFILES.into_iter().find(|profile| *profile == endpoint.profile)?;
    let arms = results.sheet.arms();
    let of = |policy: &str, oracle: bool| {
        let fits = |arm: &&Arm| arm.policy.name == policy && (arm.scorer != "learned") == oracle;
        arms.iter().find(fits).cloned()
    };
    let sets = |kind: Kind| results.sets.iter().filter(move |set| set.kind == kind);
    match &endpoint.claim {
        Claim::Policies { first, second } => {
            let [a, b] = [of(first, false)?, of(second, false)?];
            let all = sets(Kind::Base).flat_map(|set| paired(results, set, [&a, &b], &driving_score(profile)));
            Some(Compared { arm: how(&b), units: all.collect(), fault: None })
        }
        Claim::Coverage { policy } => {
            let arm = of(policy, true)?;
            let entries: Vec<&Entry> = sets(Kind::Behavior).flat_map(|set| &set.entries).collect();
            let units = changed(results, &arm, &entries, &driving_score(profile)).1;
            Some(Compared { arm: how(&arm), units, fault: None })
        }
        Claim::Axes { policy, first, second } => {
            let arm = of(policy, false)?;
            let weather: Vec<&Manifest> = sets(Kind::Weather).collect();
            let [first, second] = [first, second].map(|axis| of_axis(&weather, axis));
            let fault = gate::fault(results, &arm, &[first.clone(), second.clone()].concat());
            let [a, b] = [first, second].map(|entries| by_scenario(results, &arm, profile, &entries));
            let both = b.into_iter().filter_map(|(name, unit)| {
                let before = a.get(&name)?;
                Some(Unit { above: unit.above - before.above, ..unit })
            });
            Some(Compared { arm: how(&arm), units: both.collect(), fault })
        }
    }
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

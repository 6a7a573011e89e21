//! Studies: what an oracle that ranks the proposals gains, what changed scenarios cost, where points are lost term by term.

use std::collections::BTreeMap;

use ds_score::Term;

use super::gate;
use super::rows::{
    Anchor, INTERVALS, NO_BASE, TERM_HEADINGS, TESTED, behind, corrected, driving_score, how, mean_of, named, tested,
    tested_behind,
};
use crate::endpoint::LEARNED;
use crate::estimate::{Bootstrap, Difference, Estimate, Unit};
use crate::judge::PROFILES;
use crate::manifest::{Entry, Kind, Manifest};
use crate::results::{Drive, Results, unit};
use crate::sheet::Arm;
use crate::source::CONDITIONS;
use crate::table::{EstimateStyle, Table, Value};

/// What a drive is worth in a comparison.
type Worth = Box<dyn Fn(&Drive) -> Option<f64>>;

/// Returns the means of all terms.
pub(super) fn terms(results: &Results, anchor: Anchor, bootstrap: &mut Bootstrap) -> Table {
    let mut rows = Vec::new();
    for set in &results.sets {
        for profile in PROFILES {
            for arm in results.sheet.arms() {
                let mut row = named(anchor, set, &arm);
                row.push(Value::text(profile));
                for term in Term::ALL.map(Term::name) {
                    let estimate = bootstrap.estimate(&results.units(&arm, set, &mean_of(term, profile)));
                    row.push(Value::Estimate(estimate, EstimateStyle::Points));
                }
                rows.push(row);
            }
        }
    }
    let mut columns = vec!["policy", "set", "how", "profile"];
    columns.extend(TERM_HEADINGS);
    let note = format!(
        "Mean of each term over the ticks in which it applies, in points: where the score is lost. {INTERVALS}"
    );
    Table { id: "terms", title: "Terms", note, columns, rows }
}

/// Returns what an oracle gains over the policy's own ranking of its proposals.
pub(super) fn bias(results: &Results, anchor: Anchor, bootstrap: &mut Bootstrap) -> Table {
    let mut rows = Vec::new();
    let arms = results.sheet.arms();
    for set in &results.sets {
        for profile in PROFILES {
            let mut family: Vec<(Arm, Arm, Difference)> = Vec::new();
            for learned in arms.iter().filter(|arm| arm.scorer == LEARNED) {
                let same = |arm: &&Arm| Arm { scorer: LEARNED.to_owned(), ..(*arm).clone() } == *learned;
                for oracle in arms.iter().filter(|arm| arm.scorer != LEARNED).filter(same) {
                    let units = paired(results, set, [learned, oracle], &driving_score(profile));
                    family.push((learned.clone(), oracle.clone(), bootstrap.difference(&units)));
                }
            }
            let holm = corrected(family.iter().map(|(.., found)| found));
            for ((learned, oracle, found), p_holm) in family.into_iter().zip(holm) {
                let mut row = named(anchor, set, &oracle);
                row.push(Value::text(profile));
                for arm in [&learned, &oracle] {
                    let units = results.units(arm, set, &driving_score(profile));
                    row.push(Value::Estimate(bootstrap.estimate(&units), EstimateStyle::Points));
                }
                row.extend(tested(&found, p_holm));
                row.extend(proposals(results, &oracle, set, bootstrap));
                rows.push(row);
            }
        }
    }
    let mut columns = vec!["policy", "set", "how", "profile", "DS learned", "DS oracle"];
    columns.extend(TESTED);
    columns.extend(["best proposal", "ticks without positive", "scenarios without positive"]);
    let note = format!(
        "Scorer bias = DS with an oracle that ranks the proposals − DS with the policy's own ranking. It may be negative: \
         the oracle ranks plans, not drives. Best proposal: mean over ticks of the best score under the oracle; without \
         positive: share of ticks, and of scenarios with at least one such tick. {INTERVALS}"
    );
    Table { id: "bias", title: "Scorer bias", note, columns, rows }
}

fn proposals(results: &Results, arm: &Arm, set: &Manifest, bootstrap: &mut Bootstrap) -> [Value; 3] {
    let best = |drive: &Drive| drive.proposals.map(|stats| stats.best_mean);
    let bare = |drive: &Drive| {
        let stats = drive.proposals.filter(|stats| stats.ticks > 0)?;
        Some(f64::from(stats.ticks_without_positive) / f64::from(stats.ticks))
    };
    let any = |drive: &Drive| bare(drive).map(|share| f64::from(u8::from(share > 0.0)));
    let mut estimate = |value: &dyn Fn(&Drive) -> Option<f64>| {
        Value::Estimate(bootstrap.share(&results.units(arm, set, value)), EstimateStyle::Points)
    };
    [estimate(&best), estimate(&bare), estimate(&any)]
}

/// Returns every condition and the mean of every axis: axis, name, conditions.
pub(super) fn axes() -> Vec<(&'static str, &'static str, Vec<&'static str>)> {
    let axes = CONDITIONS.iter().flat_map(|(axis, conditions)| {
        let one = |condition: &'static str| (*axis, condition, vec![condition]);
        conditions.iter().map(move |condition| one(condition)).chain([(*axis, "mean", conditions.to_vec())])
    });
    axes.collect()
}

/// Returns DS under each condition and its difference to the base.
pub(super) fn weather(results: &Results, anchor: Anchor, bootstrap: &mut Bootstrap) -> Table {
    let mut rows = Vec::new();
    let axes = axes();
    for set in results.sets.iter().filter(|set| set.kind == Kind::Weather) {
        let parts: Vec<Part> = axes
            .iter()
            .map(|(axis, name, conditions)| {
                let these = |entry: &&Entry| conditions.contains(&entry.appearance.as_str());
                Part { words: [*axis, *name], entries: set.entries.iter().filter(these).collect() }
            })
            .collect();
        rows.extend(against_base(results, anchor, set, &parts, bootstrap));
    }
    let note = format!(
        "DS under each condition, and its difference to the same scenarios on a clear, dry day where their base set is \
         among the sets. Grip stays dry: appearance alone changes. Of generated frames a row counts only where they show its \
         conditions (table of conditions shown). Holm over the rows of a policy and profile that count. {INTERVALS}"
    );
    Table { id: "weather", title: "Weather", note, columns: headings(["axis", "condition"]), rows }
}

/// Returns DS against adversaries and its difference to the base, by class; with an oracle this is proposal coverage.
pub(super) fn behavior(results: &Results, anchor: Anchor, bootstrap: &mut Bootstrap) -> Table {
    let mut rows = Vec::new();
    for set in results.sets.iter().filter(|set| set.kind == Kind::Behavior) {
        let mut classes: BTreeMap<&str, Vec<&Entry>> = BTreeMap::new();
        set.entries.iter().for_each(|entry| classes.entry(&entry.category).or_default().push(entry));
        let mut parts = vec![Part { words: ["all", "all"], entries: set.entries.iter().collect() }];
        parts.extend(classes.into_iter().map(|(class, entries)| Part { words: ["class", class], entries }));
        rows.extend(against_base(results, anchor, set, &parts, bootstrap));
    }
    let note = format!(
        "DS against an adversary, and its difference to each variant's own base scenario where the base set is among the \
         sets. With an oracle scorer the difference is proposal coverage: what is lost although the ranking is perfect. Holm \
         over the rows of a policy and profile. {INTERVALS}"
    );
    Table { id: "behavior", title: "Adversaries", note, columns: headings(["part", "class"]), rows }
}

fn headings(words: [&'static str; 2]) -> Vec<&'static str> {
    let mut columns = vec!["policy", "set", "how", "profile"];
    columns.extend(words);
    columns.push("DS");
    columns.extend(TESTED);
    columns
}

/// Some entries of a set, with what they are called.
struct Part<'a> {
    words: [&'a str; 2],
    entries: Vec<&'a Entry>,
}

fn against_base(
    results: &Results,
    anchor: Anchor,
    set: &Manifest,
    parts: &[Part],
    bootstrap: &mut Bootstrap,
) -> Vec<Vec<Value>> {
    let mut rows = Vec::new();
    for arm in results.sheet.arms() {
        for profile in PROFILES {
            let found: Vec<(&Part, Option<&str>, Estimate, Difference)> = parts
                .iter()
                .map(|part| {
                    let (shown, differences) = changed(results, &arm, &part.entries, &driving_score(profile));
                    let alone = (differences.is_empty() && !shown.is_empty()).then_some(NO_BASE);
                    let fault = gate::fault(results, &arm, &part.entries).or(alone);
                    (part, fault, bootstrap.estimate(&shown), behind(fault, bootstrap.difference(&differences)))
                })
                .collect();
            let holm = corrected(found.iter().map(|(.., found)| found));
            for ((part, fault, shown, found), p_holm) in found.into_iter().zip(holm) {
                let mut row = named(anchor, set, &arm);
                row.push(Value::text(profile));
                row.extend(part.words.map(Value::text));
                row.push(Value::Estimate(shown, EstimateStyle::Points));
                row.extend(tested_behind(fault, &found, p_holm));
                rows.push(row);
            }
        }
    }
    rows
}

/// Returns the values of the entries of each base scenario, with the first of these.
pub(super) fn by_base<'a>(
    results: &Results,
    arm: &Arm,
    entries: impl IntoIterator<Item = &'a Entry>,
    value: &dyn Fn(&Drive) -> Option<f64>,
) -> BTreeMap<&'a str, (&'a Entry, Vec<f64>)> {
    let mut values: BTreeMap<&str, (&Entry, Vec<f64>)> = BTreeMap::new();
    for entry in entries {
        let base = entry.base.as_deref().unwrap_or(&entry.name);
        values.entry(base).or_insert_with(|| (entry, Vec::new())).1.extend(results.mean(arm, entry, value));
    }
    values
}

/// Returns a value of changed scenarios and its differences to the base, averaged over the changes of each base scenario.
pub(super) fn changed(
    results: &Results,
    arm: &Arm,
    entries: &[&Entry],
    value: &dyn Fn(&Drive) -> Option<f64>,
) -> (Vec<Unit>, Vec<Unit>) {
    let values = by_base(results, arm, entries.iter().copied(), value);
    let bases = results.sets.iter().filter(|set| set.kind == Kind::Base).flat_map(|set| &set.entries);
    let known: BTreeMap<&str, f64> = bases
        .filter(|entry| values.contains_key(entry.name.as_str()))
        .filter_map(|entry| Some((entry.name.as_str(), results.mean(arm, entry, value)?)))
        .collect();
    let (mut shown, mut differences) = (Vec::new(), Vec::new());
    for (base, (entry, values)) in values {
        shown.extend(ds_stats::mean(values.iter().copied()).map(|mean| unit(entry, mean, 1.0)));
        let Some(before) = known.get(base) else { continue };
        differences
            .extend(ds_stats::mean(values.iter().map(|value| value - before)).map(|mean| unit(entry, mean, 1.0)));
    }
    (shown, differences)
}

/// Returns the paired differences of two arms, the second minus the first.
pub(super) fn paired(
    results: &Results,
    set: &Manifest,
    [a, b]: [&Arm; 2],
    value: &dyn Fn(&Drive) -> Option<f64>,
) -> Vec<Unit> {
    let one = |entry| Some(unit(entry, results.mean(b, entry, value)? - results.mean(a, entry, value)?, 1.0));
    set.entries.iter().filter_map(one).collect()
}

/// Returns the paired differences of all pairs of arms.
pub(super) fn differences(results: &Results, bootstrap: &mut Bootstrap) -> Table {
    let mut rows = Vec::new();
    let arms = results.sheet.arms();
    for set in &results.sets {
        let mut metrics: Vec<(String, Worth)> = Vec::new();
        for profile in PROFILES {
            metrics.push((format!("DS {profile}"), Box::new(driving_score(profile))));
        }
        metrics.push(("success".to_owned(), Box::new(Drive::success)));
        let entries: Vec<&Entry> = set.entries.iter().collect();
        for (name, value) in &metrics {
            let mut family = Vec::new();
            for (k, a) in arms.iter().enumerate() {
                for b in &arms[k + 1..] {
                    let fault = [a, b].into_iter().find_map(|arm| gate::fault(results, arm, &entries));
                    let found = bootstrap.difference(&paired(results, set, [a, b], value.as_ref()));
                    family.push((a, b, fault, behind(fault, found)));
                }
            }
            let holm = corrected(family.iter().map(|(.., found)| found));
            for ((a, b, fault, found), p_holm) in family.into_iter().zip(holm) {
                let [a, b] = [a, b].map(|arm| Value::text(format!("{} · {}", arm.policy.name, how(arm))));
                let mut row = vec![a, b, Value::text(&set.name), Value::text(name)];
                row.extend(tested_behind(fault, &found, p_holm));
                rows.push(row);
            }
        }
    }
    let mut columns = vec!["first", "second", "set", "metric"];
    columns.extend(TESTED);
    let note = format!(
        "Second minus first, paired by scenario, in points. p: sign flips of whole logs; Holm over all pairs of a set and \
         metric. Detectable: 2.8 standard errors, the difference that such a study finds four times in five. All pairs are \
         exploratory; endpoints that were declared before the run stand in a table of their own. {INTERVALS}"
    );
    Table { id: "differences", title: "Paired differences", note, columns, rows }
}

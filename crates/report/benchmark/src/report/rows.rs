//! What several tables have in their rows: who drove how, and what a paired difference says.

use ds_stats::holm;

use crate::estimate::Difference;
use crate::manifest::Manifest;
use crate::results::{Drive, Results};
use crate::sheet::Arm;
use crate::table::{EstimateStyle, Value};

/// Below this corrected p-value a difference counts as found.
pub(super) const LEVEL: f64 = 0.05;
/// Why a difference to the base is not tested of which there is none.
pub(super) const NO_BASE: &str = "not tested: the base was not driven";
/// Headings of [`tested`].
pub(super) const TESTED: [&str; 6] = ["difference", "scenarios", "p", "p Holm", "detectable", "verdict"];
/// Headings of the terms, in their order.
pub(super) const TERM_HEADINGS: [&str; 8] = ["NC", "DAC", "DDC", "TLC", "TTC", "LK", "HC", "EC"];
/// How the intervals of a table are made.
pub(super) const INTERVALS: &str = "Intervals: 95 % percentile bootstrap, 10,000 draws, over scenarios and over whole logs; \
                                    the wider one is shown, both are in the files.";

/// Says of a policy whether it is privileged.
pub(super) type Anchor<'a> = &'a dyn Fn(&str) -> bool;

/// Returns the first cells of a row.
pub(super) fn named(anchor: Anchor, set: &Manifest, arm: &Arm) -> Vec<Value> {
    let policy = &arm.policy.name;
    let policy = if anchor(policy) { format!("{policy} (anchor)") } else { policy.clone() };
    vec![Value::text(policy), Value::text(&set.name), Value::text(how(arm))]
}

/// Says what besides the policy tells an arm.
pub(super) fn how(arm: &Arm) -> String {
    format!("{} · {} · {}", arm.observation.name, arm.agents.name(), arm.scorer)
}

/// Returns the driving score in a profile.
pub(super) fn driving_score(profile: &'static str) -> impl Fn(&Drive) -> Option<f64> {
    move |drive| drive.score(profile, |scores| scores.driving_score)
}

/// Returns the mean of a term over the ticks of a drive in which it applies.
pub(super) fn mean_of(term: &'static str, profile: &'static str) -> impl Fn(&Drive) -> Option<f64> {
    move |drive| *drive.judged.as_ref()?.scores.get(profile)?.terms.get(term)?
}

/// Counts scenarios, logs, failed and aborted drives.
pub(super) fn counted(set: &Manifest, results: &Results, arm: &Arm) -> [Value; 4] {
    use ds_run_report::results::Outcome as Ending;
    let drives: Vec<&Drive> = set.entries.iter().flat_map(|entry| results.of(arm, entry)).collect();
    let ended = |ending| drives.iter().filter(|drive| drive.ending == ending).count();
    let logs: std::collections::BTreeSet<&str> = set.entries.iter().map(|entry| entry.log.as_str()).collect();
    [set.entries.len(), logs.len(), ended(Ending::Failed), ended(Ending::Aborted)].map(Value::count)
}

/// Returns p-values corrected over a family; nothing where there is none.
pub(super) fn corrected<'a>(family: impl Iterator<Item = &'a Difference>) -> Vec<Option<f64>> {
    let p: Vec<Option<f64>> = family.map(|found| found.p).collect();
    let mut corrected = holm(&p.iter().flatten().copied().collect::<Vec<_>>()).into_iter();
    p.iter().map(|p| p.and_then(|_| corrected.next())).collect()
}

/// Returns the cells of a paired difference, headed by [`TESTED`].
pub(super) fn tested(found: &Difference, p_holm: Option<f64>) -> [Value; 6] {
    let verdict = match p_holm {
        None => "not tested: fewer than 5 scenarios or 2 logs",
        Some(p) if p <= LEVEL => "found at 5 %",
        Some(_) => "not found at 5 %",
    };
    [
        Value::Estimate(found.estimate, EstimateStyle::Signed),
        Value::count(found.estimate.scenarios),
        Value::Chance(found.p),
        Value::Chance(p_holm),
        Value::Score(found.detectable),
        Value::text(verdict),
    ]
}

/// Returns a difference without its test where a fault forbids every claim, so that it is no part of the correction.
pub(super) fn behind(fault: Option<&str>, found: Difference) -> Difference {
    if fault.is_some() { Difference { p: None, ..found } } else { found }
}

/// Returns the cells of a paired difference; the verdict is the fault, if there is one.
pub(super) fn tested_behind(fault: Option<&str>, found: &Difference, p_holm: Option<f64>) -> [Value; 6] {
    let mut cells = tested(found, p_holm);
    if let Some(fault) = fault {
        cells[5] = Value::text(fault);
    }
    cells
}

//! Two runs → paired differences on the scenarios that both drove, with intervals and p-values.
//!
//! Drives are paired by scenario, set, seed, policy, observation, appearance and scorer; a dimension in which each run
//! has exactly one value, or that is renamed, may differ. Differences are `b - a` of headline values (failed drives
//! count 0), averaged within a scenario, then over scenarios. A pair with an aborted drive, or to which the metric
//! does not apply on either side, is left out of that metric and counted.

use std::collections::{BTreeMap, BTreeSet};

use ds_space::Draws;
use ds_stats::{EXACT_UP_TO, holm, mean, sign_flip};
use serde::Serialize;

use crate::aggregate::{WEIGHTING, with_profile};
use crate::bootstrap::{self, Interval};
use crate::dimension::{Dimension, Drive, drives, run_names};
use crate::metric::{Applicable, Metric, metrics_of};
use crate::results::{Outcome, Results};

#[cfg(test)]
mod tests;

/// Below this many scenarios nothing is said about significance.
pub const FEWEST_SCENARIOS: usize = 5;
/// The level of significance.
pub const LEVEL: f64 = 0.05;

const JOINED_BY: [Dimension; 5] =
    [Dimension::Set, Dimension::Policy, Dimension::Observation, Dimension::Appearance, Dimension::Scorer];

/// Which drives of two runs belong together.
#[derive(Debug, Clone, Default)]
pub struct Pairing {
    /// Per dimension: a value in run A → the value in run B that it is compared with. A dimension that is not named
    /// here pairs equal values, or whatever the two runs have if each has one value only.
    pub renames: BTreeMap<Dimension, BTreeMap<String, String>>,
    /// What splits the comparison, by the values of run A.
    pub by: Vec<Dimension>,
}

/// The answer.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// Name of the first run.
    pub a: String,
    /// Name of the second run; a positive difference means that it is better.
    pub b: String,
    /// How values are weighted.
    pub weighting: &'static str,
    /// How p-values are made.
    pub test: String,
    /// What a reader has to know to trust the differences.
    pub notes: Vec<String>,
    /// What splits the groups.
    pub by: Vec<Dimension>,
    /// The groups in order of their keys.
    pub groups: Vec<ComparedGroup>,
    /// Drives without a partner, by scenario.
    pub unmatched: Vec<Unmatched>,
}

/// Paired drives that agree in all dimensions of the comparison.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ComparedGroup {
    /// One value per dimension.
    pub key: Vec<String>,
    /// Different scenarios.
    pub scenarios: usize,
    /// Pairs of drives.
    pub pairs: usize,
    /// One entry per metric.
    pub metrics: Vec<Difference>,
}

/// One metric of a comparison.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// The metric's name in files.
    pub metric: String,
    /// Mean of the first run over the paired scenarios.
    pub a: Option<f64>,
    /// Mean of the second run over the paired scenarios.
    pub b: Option<f64>,
    /// Mean of `b - a`.
    pub difference: Option<f64>,
    /// Its interval.
    pub interval: Option<Interval>,
    /// Scenarios that the means are over.
    pub scenarios: usize,
    /// Pairs left out because one of the drives was aborted.
    pub aborted_pairs: usize,
    /// Pairs left out because the metric does not apply to both.
    pub not_applicable_pairs: usize,
    /// p-value of this metric by itself; nothing below [`FEWEST_SCENARIOS`].
    pub p: Option<f64>,
    /// p-value after Holm's correction over the metrics of the group.
    pub p_holm: Option<f64>,
    /// Whether every sign pattern was tried.
    pub exact: bool,
    /// The conclusion.
    pub verdict: Verdict,
}

/// The conclusion of a test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The corrected p-value is at most 5 %.
    Significant,
    /// It is not.
    NotSignificant,
    /// It is not, and with so few scenarios it could not have been.
    OutOfReach,
    /// Fewer than [`FEWEST_SCENARIOS`].
    TooFewScenarios,
}

impl Verdict {
    /// Returns the conclusion in words.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::Significant => "significant at 5 %",
            Self::NotSignificant => "not significant at 5 %",
            Self::OutOfReach => "not significant at 5 % (so few scenarios cannot be)",
            Self::TooFewScenarios => "too few scenarios",
        }
    }
}

/// Drives of one scenario that only one run has.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Unmatched {
    /// `a` or `b`: the run that has them.
    pub run: &'static str,
    /// The scenario set.
    pub set: String,
    /// The scenario.
    pub scenario: String,
    /// How many drives.
    pub episodes: usize,
    /// Whether other drives of the scenario have partners.
    pub partly: bool,
}

/// Compares two runs; differences are `b - a`.
#[must_use]
pub fn compare(a: &Results, b: &Results, pairing: &Pairing, seed: u64) -> Comparison {
    let runs = [a.clone(), b.clone()];
    let names = run_names(&runs);
    let all = drives(&runs);
    let (left, right): (Vec<Drive>, Vec<Drive>) = all.iter().cloned().partition(|drive| drive.place.0 == 0);
    let pairs = pair(&left, &right, pairing);
    let by = with_profile(&pairing.by, &left);
    let (metrics, applicable) = (metrics_of(&all), Applicable::of(&all));
    let mut groups: BTreeMap<Vec<String>, Vec<&Pair>> = BTreeMap::new();
    for pair in &pairs.pairs {
        groups.entry(by.iter().map(|dimension| dimension.of(&pair.a[0])).collect()).or_default().push(pair);
    }
    let mut notes = pairs.notes;
    let profiles = [&left, &right].map(|drives| Dimension::Profile.values(drives));
    if profiles[0] != profiles[1] {
        let text = "score profiles differ, so differences mix the definition of the score with the drives";
        notes.push(format!("{text}: {:?} and {:?}", profiles[0], profiles[1]));
    }
    if a.by_wall_clock() != b.by_wall_clock() {
        let text =
            "only one of the runs was driven by the wall clock, so differences hold the latency of a machine too";
        notes.push(text.to_owned());
    }
    Comparison {
        a: names[0].clone(),
        b: names[1].clone(),
        weighting: WEIGHTING,
        test: format!(
            "paired sign-flip test over scenarios, two-sided, exact up to {EXACT_UP_TO} scenarios; \
             Holm's correction over the metrics of a group"
        ),
        notes,
        by,
        groups: groups
            .into_iter()
            .map(|(key, pairs)| {
                let differences = metrics.iter().map(|metric| difference(metric, &pairs, &applicable, seed));
                compared(key, &pairs, differences.collect())
            })
            .collect(),
        unmatched: pairs.unmatched,
    }
}

/// Drives that belong together; more than one on a side if the dimensions given do not tell them apart.
#[derive(Default)]
pub(crate) struct Pair<'a> {
    pub(crate) a: Vec<Drive<'a>>,
    pub(crate) b: Vec<Drive<'a>>,
}

pub(crate) struct Pairs<'a> {
    pub(crate) pairs: Vec<Pair<'a>>,
    pub(crate) unmatched: Vec<Unmatched>,
    pub(crate) notes: Vec<String>,
}

/// Joins drives by scenario, seed and the dimensions of [`JOINED_BY`].
pub(crate) fn pair<'a>(a: &[Drive<'a>], b: &[Drive<'a>], pairing: &Pairing) -> Pairs<'a> {
    let mut renames = pairing.renames.clone();
    let mut notes = Vec::new();
    for dimension in JOINED_BY {
        let [only_a, only_b] = [a, b].map(|drives| single(dimension, drives));
        if let (Some(from), Some(to), false) = (only_a, only_b, renames.contains_key(&dimension)) {
            if from != to {
                notes.push(format!("{dimension} {from:?} of the first run is compared with {to:?} of the second"));
            }
            renames.insert(dimension, BTreeMap::from([(from, to)]));
        }
    }
    let key = |drive: &Drive, rename: bool| {
        let join = |dimension: Dimension| {
            let value = dimension.of(drive);
            let renamed = renames.get(&dimension).filter(|_| rename).and_then(|names| names.get(&value).cloned());
            renamed.unwrap_or(value)
        };
        (drive.episode.scenario.clone(), drive.episode.seed, JOINED_BY.map(join))
    };
    let mut joined: BTreeMap<_, Pair> = BTreeMap::new();
    for drive in a {
        joined.entry(key(drive, true)).or_default().a.push(drive.clone());
    }
    for drive in b {
        joined.entry(key(drive, false)).or_default().b.push(drive.clone());
    }
    let (pairs, alone): (Vec<Pair>, Vec<Pair>) =
        joined.into_values().partition(|pair| !pair.a.is_empty() && !pair.b.is_empty());
    let unmatched = unmatched(&pairs, &alone);
    Pairs { pairs, unmatched, notes }
}

fn single(dimension: Dimension, drives: &[Drive]) -> Option<String> {
    let mut values = dimension.values(drives);
    if values.len() == 1 { values.pop_first() } else { None }
}

fn unmatched(pairs: &[Pair], alone: &[Pair]) -> Vec<Unmatched> {
    let paired: BTreeSet<_> =
        pairs.iter().flat_map(|pair| [("a", pair.a[0].unit()), ("b", pair.b[0].unit())]).collect();
    let mut counts: BTreeMap<_, usize> = BTreeMap::new();
    for (run, drives) in alone.iter().flat_map(|pair| [("a", &pair.a), ("b", &pair.b)]) {
        for drive in drives {
            *counts.entry((run, drive.unit())).or_default() += 1;
        }
    }
    let entry = |((run, (set, scenario)), episodes): ((&'static str, (String, String)), usize)| {
        let partly = paired.contains(&(run, (set.clone(), scenario.clone())));
        Unmatched { run, set, scenario, episodes, partly }
    };
    counts.into_iter().map(entry).collect()
}

fn compared(key: Vec<String>, pairs: &[&Pair], mut metrics: Vec<Difference>) -> ComparedGroup {
    let p_values: Vec<f64> = metrics.iter().filter_map(|difference| difference.p).collect();
    let tested = p_values.len() as f64;
    let corrected = holm(&p_values);
    // Differences of one sign have the smallest p-value there is; Holm multiplies the smallest of all by their number.
    let smallest = |scenarios: usize| 2.0 * 0.5f64.powi(i32::try_from(scenarios.min(1000)).unwrap_or(1000));
    let most = metrics.iter().map(|difference| difference.scenarios).max().unwrap_or_default();
    for (difference, p_holm) in metrics.iter_mut().filter(|difference| difference.p.is_some()).zip(corrected) {
        difference.p_holm = Some(p_holm);
        difference.verdict = match p_holm <= LEVEL {
            true => Verdict::Significant,
            false if smallest(difference.scenarios).max(tested * smallest(most)) > LEVEL => Verdict::OutOfReach,
            false => Verdict::NotSignificant,
        };
    }
    let scenarios = pairs.iter().map(|pair| pair.a[0].unit()).collect::<BTreeSet<_>>().len();
    ComparedGroup { key, scenarios, pairs: pairs.len(), metrics }
}

fn difference(metric: &Metric, pairs: &[&Pair], applicable: &Applicable, seed: u64) -> Difference {
    let (mut aborted_pairs, mut not_applicable_pairs) = (0, 0);
    let mut units: BTreeMap<_, Vec<(f64, f64)>> = BTreeMap::new();
    for pair in pairs {
        let side = |drives: &[Drive]| mean(drives.iter().filter_map(|drive| metric.headline(drive, applicable)));
        let aborted = |drives: &[Drive]| drives.iter().all(|drive| drive.episode.outcome() == Outcome::Aborted);
        match (side(&pair.a), side(&pair.b)) {
            (Some(a), Some(b)) => units.entry(pair.a[0].unit()).or_default().push((a, b)),
            _ if aborted(&pair.a) || aborted(&pair.b) => aborted_pairs += 1,
            _ => not_applicable_pairs += 1,
        }
    }
    let over = |value: &dyn Fn(&(f64, f64)) -> f64| -> Vec<f64> {
        units.values().filter_map(|pairs| mean(pairs.iter().map(value))).collect()
    };
    let differences = over(&|(a, b)| b - a);
    let flips = Draws::from_seed(seed, "report/sign flips");
    let chance = (differences.len() >= FEWEST_SCENARIOS).then(|| sign_flip(&differences, &flips)).flatten();
    Difference {
        metric: metric.name(),
        a: mean(over(&|(a, _)| *a)),
        b: mean(over(&|(_, b)| *b)),
        difference: mean(differences.iter().copied()),
        interval: bootstrap::mean_interval(&differences, &bootstrap::draws(seed)),
        scenarios: differences.len(),
        aborted_pairs,
        not_applicable_pairs,
        p: chance.map(|chance| chance.p),
        p_holm: None,
        exact: chance.is_none_or(|chance| chance.exact),
        verdict: Verdict::TooFewScenarios,
    }
}

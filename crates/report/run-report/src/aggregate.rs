//! Drives → means per group, with intervals and counts of what failed, aborted or did not apply.
//!
//! The scenario is the unit: `mean over scenarios (mean over the drives of the scenario)`, so a scenario driven with
//! many seeds weighs no more than another. Two means stand side by side: the headline, where a failed drive counts 0,
//! and the mean over finished drives. Aborted drives enter neither; both counts are in every group.

use std::collections::{BTreeMap, BTreeSet};

use ds_stats::mean;
use serde::Serialize;

use crate::bootstrap::{self, Interval};
use crate::dimension::{Dimension, Drive};
use crate::metric::{Applicable, Metric, metrics_of};
use crate::results::Outcome;

#[cfg(test)]
mod tests;

/// How values are weighted, in words; part of every output.
pub const WEIGHTING: &str = "mean over the drives of a scenario first (seeds and whatever else a group holds), \
    then over scenarios, every scenario with the same weight";
/// Which of the two means is the headline, in words; part of every output.
pub const HEADLINE: &str = "headline: a failed drive counts 0 (in a sub-metric only if that applies to the scenario), \
    an aborted one is left out and counted; finished: completed drives only";
/// How intervals are made, in words; part of every output.
pub const INTERVALS: &str = "95 % percentile bootstrap over scenarios, 2,000 resamples";

/// Means of all metrics for all groups.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Aggregate {
    /// What tells the groups apart.
    pub by: Vec<Dimension>,
    /// See [`WEIGHTING`].
    pub weighting: &'static str,
    /// See [`HEADLINE`].
    pub headline: &'static str,
    /// See [`INTERVALS`].
    pub intervals: &'static str,
    /// Seed of the bootstrap.
    pub seed: u64,
    /// The groups in order of their keys.
    pub groups: Vec<Group>,
}

/// Drives that agree in all dimensions of an aggregate.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Group {
    /// One value per dimension, in their order.
    pub key: Vec<String>,
    /// How many scenarios and drives there are, and how they ended.
    pub counts: Counts,
    /// One entry per metric that any drive of the aggregate has.
    pub metrics: Vec<Summary>,
    /// Where the mean score went; nothing if no drive tells.
    pub lost: Option<Losses>,
}

/// How many drives there are, and how they ended.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Different scenarios.
    pub scenarios: usize,
    /// Drives.
    pub episodes: usize,
    /// Drives that came to their end.
    pub completed: usize,
    /// Drives that the policy ended.
    pub failed: usize,
    /// Drives that the infrastructure ended, or that have not ended.
    pub aborted: usize,
}

/// One metric of a group.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// The metric's name in files.
    pub metric: String,
    /// With failed drives as 0.
    pub headline: Estimate,
    /// Over completed drives only.
    pub finished: Estimate,
    /// Completed drives to which the metric does not apply.
    pub not_applicable: usize,
}

/// A mean over scenarios with its interval.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Estimate {
    /// The mean; nothing if no scenario has a value.
    pub mean: Option<f64>,
    /// Its interval; nothing below two scenarios.
    pub interval: Option<Interval>,
    /// Scenarios with a value.
    pub scenarios: usize,
}

/// What the mean score of a group is made of: `kept + by_term + to_failures + unexplained = 1`.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Losses {
    /// The mean score, failed drives as 0.
    pub kept: f64,
    /// Lost per term in completed drives.
    pub by_term: BTreeMap<String, f64>,
    /// Lost because drives failed.
    pub to_failures: f64,
    /// What the terms do not add up to.
    pub unexplained: f64,
    /// Scenarios that the means are over.
    pub scenarios: usize,
}

impl Group {
    /// Returns a metric's summary by its name in files.
    #[must_use]
    pub fn metric(&self, name: &str) -> Option<&Summary> {
        self.metrics.iter().find(|summary| summary.metric == name)
    }
}

/// Groups drives and averages every metric; drives with different score profiles are never averaged together.
#[must_use]
pub fn aggregate(drives: &[Drive], by: &[Dimension], seed: u64) -> Aggregate {
    let by = with_profile(by, drives);
    let metrics = metrics_of(drives);
    let applicable = Applicable::of(drives);
    let mut groups = Vec::new();
    for (key, drives) in grouped(drives, &by) {
        let metrics = summaries(&drives, &metrics, &applicable, seed);
        groups.push(Group { key, counts: counts(&drives), metrics, lost: losses(&drives) });
    }
    Aggregate { by, weighting: WEIGHTING, headline: HEADLINE, intervals: INTERVALS, seed, groups }
}

/// Adds the profile to the dimensions if the drives differ in it.
pub(crate) fn with_profile(by: &[Dimension], drives: &[Drive]) -> Vec<Dimension> {
    let mut by = by.to_vec();
    if !by.contains(&Dimension::Profile) && Dimension::Profile.values(drives).len() > 1 {
        by.push(Dimension::Profile);
    }
    by
}

/// Splits drives by the values of some dimensions.
pub(crate) fn grouped<'a>(drives: &[Drive<'a>], by: &[Dimension]) -> BTreeMap<Vec<String>, Vec<Drive<'a>>> {
    let mut groups: BTreeMap<Vec<String>, Vec<Drive>> = BTreeMap::new();
    for drive in drives {
        let key = by.iter().map(|dimension| dimension.of(drive)).collect();
        groups.entry(key).or_default().push(drive.clone());
    }
    groups
}

/// Splits drives by scenario.
pub(crate) fn by_scenario<'a, 'b>(drives: &'b [Drive<'a>]) -> BTreeMap<(String, String), Vec<&'b Drive<'a>>> {
    let mut scenarios: BTreeMap<_, Vec<&Drive>> = BTreeMap::new();
    for drive in drives {
        scenarios.entry(drive.unit()).or_default().push(drive);
    }
    scenarios
}

/// Averages one value of every drive over drives, then scenarios, with an interval.
pub(crate) fn estimate(drives: &[Drive], seed: u64, value: &dyn Fn(&Drive) -> Option<f64>) -> Estimate {
    estimates(vec![column(drives, value)], seed).pop().unwrap_or_default()
}

fn summaries(drives: &[Drive], metrics: &[Metric], applicable: &Applicable, seed: u64) -> Vec<Summary> {
    let headline = metrics.iter().map(|metric| column(drives, &|drive| metric.headline(drive, applicable)));
    let finished = metrics.iter().map(|metric| column(drives, &|drive| metric.finished(drive.episode)));
    let mut headline = estimates(headline.chain(finished).collect(), seed);
    let finished = headline.split_off(metrics.len());
    let summary = |((metric, headline), finished): ((&Metric, Estimate), Estimate)| Summary {
        metric: metric.name(),
        headline,
        finished,
        not_applicable: drives
            .iter()
            .filter(|drive| drive.episode.outcome() == Outcome::Completed && metric.of(drive.episode).is_none())
            .count(),
    };
    metrics.iter().zip(headline).zip(finished).map(summary).collect()
}

/// One value per scenario: the mean over its drives that have one.
fn column(drives: &[Drive], value: &dyn Fn(&Drive) -> Option<f64>) -> Vec<Option<f64>> {
    by_scenario(drives).values().map(|drives| mean(drives.iter().filter_map(|drive| value(drive)))).collect()
}

fn estimates(columns: Vec<Vec<Option<f64>>>, seed: u64) -> Vec<Estimate> {
    let intervals = bootstrap::mean_intervals(&columns, &bootstrap::draws(seed));
    let estimate = |(column, interval): (Vec<Option<f64>>, Option<Interval>)| Estimate {
        mean: mean(column.iter().copied().flatten()),
        interval,
        scenarios: column.iter().flatten().count(),
    };
    columns.into_iter().zip(intervals).map(estimate).collect()
}

/// Counts drives by how they ended.
#[must_use]
pub fn counts(drives: &[Drive]) -> Counts {
    let ended = |outcome| drives.iter().filter(|drive| drive.episode.outcome() == outcome).count();
    Counts {
        scenarios: drives.iter().map(Drive::unit).collect::<BTreeSet<_>>().len(),
        episodes: drives.len(),
        completed: ended(Outcome::Completed),
        failed: ended(Outcome::Failed),
        aborted: ended(Outcome::Aborted),
    }
}

/// A completed drive tells where its mean score went if it has one and names what was lost, or lost nothing.
fn losses(drives: &[Drive]) -> Option<Losses> {
    let tells = |drive: &Drive| match drive.episode.outcome() {
        Outcome::Completed => {
            drive.episode.mean_score.is_some_and(|mean| !drive.episode.lost.is_empty() || mean >= 1.0)
        }
        Outcome::Failed => true,
        Outcome::Aborted => false,
    };
    let telling: Vec<Drive> = drives.iter().filter(|drive| tells(drive)).cloned().collect();
    if telling.iter().all(|drive| drive.episode.outcome() == Outcome::Failed) {
        return None;
    }
    let over = |value: &dyn Fn(&Drive) -> f64| {
        let scenarios = column(&telling, &|drive| Some(value(drive)));
        mean(scenarios.into_iter().flatten()).unwrap_or_default()
    };
    let completed = |drive: &Drive, value: f64| if drive.episode.outcome() == Outcome::Completed { value } else { 0.0 };
    let terms: BTreeSet<&String> = telling.iter().flat_map(|drive| drive.episode.lost.keys()).collect();
    let by_term: BTreeMap<String, f64> = terms
        .into_iter()
        .map(|term| {
            let lost = |drive: &Drive| completed(drive, drive.episode.lost.get(term).copied().unwrap_or_default());
            (term.clone(), over(&lost))
        })
        .collect();
    let kept = over(&|drive| completed(drive, drive.episode.mean_score.unwrap_or_default()));
    let to_failures = over(&|drive| f64::from(u8::from(drive.episode.outcome() == Outcome::Failed)));
    let unexplained = 1.0 - kept - to_failures - by_term.values().sum::<f64>();
    Some(Losses { kept, by_term, to_failures, unexplained, scenarios: by_scenario(&telling).len() })
}

//! The level of a report's intervals: means over scenarios drawn with replacement, from the 2.5th to the 97.5th
//! percentile of the resampled means. Below five scenarios such intervals are too narrow.

use ds_space::Draws;
use ds_stats::bootstrap::MeanBootstrap;
use serde::Serialize;

/// Resamples of an interval.
pub const RESAMPLES: u64 = 2_000;
/// What share of such intervals holds the true mean, for many scenarios.
pub const CONFIDENCE: f64 = 0.95;

const PLAN: MeanBootstrap = MeanBootstrap { times: RESAMPLES, tail: (1.0 - CONFIDENCE) / 2.0 };

/// A range that holds the true mean with [`CONFIDENCE`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Interval {
    /// The lower end.
    pub low: f64,
    /// The upper end.
    pub high: f64,
}

impl From<[f64; 2]> for Interval {
    fn from([low, high]: [f64; 2]) -> Self {
        Self { low, high }
    }
}

/// Returns the draws of a report, from its seed.
#[must_use]
pub fn draws(seed: u64) -> Draws {
    Draws::from_seed(seed, "report/bootstrap")
}

/// Returns an interval for the mean of each column; columns have one entry per scenario, `None` where the scenario
/// has no value.
///
/// A column with fewer than two values has no interval. All columns must have the same length.
#[must_use]
pub fn mean_intervals(columns: &[Vec<Option<f64>>], draws: &Draws) -> Vec<Option<Interval>> {
    PLAN.means(columns, draws).into_iter().map(|ends| ends.map(Interval::from)).collect()
}

/// Returns an interval for the mean of one column.
#[must_use]
pub fn mean_interval(values: &[f64], draws: &Draws) -> Option<Interval> {
    mean_intervals(&[values.iter().copied().map(Some).collect()], draws).pop().flatten()
}

/// Returns an interval for the mean of `left` minus the mean of `right`, drawn independently of each other.
#[must_use]
pub fn difference_interval(left: &[f64], right: &[f64], seed: u64) -> Option<Interval> {
    let streams = [Draws::from_seed(seed, "report/left"), Draws::from_seed(seed, "report/right")];
    PLAN.difference([left, right], &streams).map(Interval::from)
}

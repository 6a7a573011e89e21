//! Figures with their intervals, from scenarios drawn with replacement (percentile bootstrap).
//!
//! A figure is a function of which scenarios are drawn, each as often as it is drawn; figures of several arms over the
//! same scenarios are computed from the same draws, so that their difference is paired.

use ds_space::Draws;
pub use ds_stats::mean;
use ds_stats::{bootstrap::pick, percentiles};
use serde::{Deserialize, Serialize};

/// A figure with its interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Over all scenarios.
    pub value: f64,
    /// Where 5 % of the resamples lie below.
    pub low: f64,
    /// Where 5 % of the resamples lie above.
    pub high: f64,
    /// Scenarios (rollouts) that the figure is of.
    pub samples: u64,
}

/// What share of the resamples lies within an interval.
pub const CONFIDENCE: f64 = 0.90;

/// How often scenarios are drawn anew.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Resamples(pub u64);

impl Resamples {
    /// Computes a figure of `count` scenarios with its interval; none where the figure of all is unknown.
    pub fn estimate(self, count: usize, figure: impl Fn(&[usize]) -> Option<f64>) -> Option<Estimate> {
        let all: Vec<usize> = (0..count).collect();
        let value = figure(&all).filter(|value| value.is_finite())?;
        let resample = |index: u64| {
            let draws = Draws::from_seed(index, "appraisal bootstrap");
            figure(&pick(&draws, 0, count)).filter(|value| value.is_finite())
        };
        let values: Vec<f64> = (0..self.0).filter_map(resample).collect();
        let [low, high] = percentiles(values, 0.5 * (1.0 - CONFIDENCE)).unwrap_or([value; 2]);
        Some(Estimate { value, low, high, samples: count as u64 })
    }

    /// Computes the mean of values with its interval; none of no values.
    #[must_use]
    pub fn mean(self, values: &[f64]) -> Option<Estimate> {
        self.estimate(values.len(), |picks| mean(picks.iter().map(|pick| values[*pick])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_hold_the_value_and_shrink_with_more_scenarios() {
        let values = |count: u64| -> Vec<f64> {
            let draws = Draws::from_seed(3, "estimate test");
            (0..count).map(|index| draws.normal(index)).collect()
        };
        let (few, many) = (values(10), values(400));
        let (few, many) = (Resamples(400).mean(&few).expect("a mean"), Resamples(400).mean(&many).expect("a mean"));
        for estimate in [few, many] {
            assert!(estimate.low < estimate.value && estimate.value < estimate.high, "{estimate:?}");
        }
        // 90 % of means of 400 normal draws lie within 1.645/20 of the true one.
        assert!((many.high - many.low - 2.0 * 1.645 / 20.0).abs() < 0.04, "{many:?}");
        assert!(few.high - few.low > 2.0 * (many.high - many.low));
        assert_eq!((few.samples, many.samples), (10, 400));
    }

    #[test]
    fn unknown_figures_have_no_estimate() {
        assert_eq!(Resamples(10).mean(&[]), None);
        assert_eq!(Resamples(10).estimate(4, |_| Some(f64::NAN)), None);
        let one = Resamples(10).mean(&[2.0]).expect("a mean");
        assert_eq!((one.value, one.low, one.high), (2.0, 2.0, 2.0));
    }
}

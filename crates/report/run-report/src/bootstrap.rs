//! Percentile bootstrap intervals of means over scenarios (Efron 1979; Efron and Tibshirani 1993, chapter 13).
//!
//! Scenarios are drawn with replacement, all metrics of a scenario together; the interval goes from the 2.5th to the
//! 97.5th percentile of the resampled means. Draws are a function of seed, resample and position, so the same
//! scenarios are drawn for every group of the same size. Below five scenarios such intervals are too narrow.

use ds_space::Draws;
use serde::Serialize;

/// Resamples of an interval.
pub const RESAMPLES: u64 = 2_000;
/// What share of such intervals holds the true mean, for many scenarios.
pub const CONFIDENCE: f64 = 0.95;

/// A range that holds the true mean with [`CONFIDENCE`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Interval {
    /// The lower end.
    pub low: f64,
    /// The upper end.
    pub high: f64,
}

/// Returns the draws of a report, from its seed.
#[must_use]
pub fn draws(seed: u64) -> Draws {
    Draws::from_seed(seed, "report/bootstrap")
}

/// Returns the mean in order of the values; nothing for no values.
#[must_use]
pub fn mean(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.into_iter().fold((0.0, 0u32), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

/// Returns an interval for the mean of each column; columns have one entry per scenario, `None` where the scenario
/// has no value.
///
/// A column with fewer than two values has no interval. All columns must have the same length.
#[must_use]
pub fn mean_intervals(columns: &[Vec<Option<f64>>], draws: &Draws) -> Vec<Option<Interval>> {
    let scenarios = columns.first().map_or(0, Vec::len);
    assert!(columns.iter().all(|column| column.len() == scenarios), "columns of one table have one length");
    if scenarios < 2 {
        return vec![None; columns.len()];
    }
    let filled: Vec<Vec<(f64, f64)>> = columns
        .iter()
        .map(|column| column.iter().map(|value| value.map_or((0.0, 0.0), |value| (value, 1.0))).collect())
        .collect();
    let mut means: Vec<Vec<f64>> = vec![Vec::new(); columns.len()];
    let mut picks = vec![0usize; scenarios];
    for resample in 0..RESAMPLES {
        pick(&mut picks, resample, draws);
        for (column, means) in filled.iter().zip(&mut means) {
            let (mut sum, mut count) = (0.0, 0.0);
            for &scenario in &picks {
                sum += column[scenario].0;
                count += column[scenario].1;
            }
            if count > 0.0 {
                means.push(sum / count);
            }
        }
    }
    let enough = |column: &Vec<Option<f64>>| column.iter().flatten().count() >= 2;
    columns.iter().zip(means).map(|(column, means)| enough(column).then(|| percentiles(means)).flatten()).collect()
}

/// Returns an interval for the mean of one column.
#[must_use]
pub fn mean_interval(values: &[f64], draws: &Draws) -> Option<Interval> {
    mean_intervals(&[values.iter().copied().map(Some).collect()], draws).pop().flatten()
}

/// Returns an interval for the mean of `left` minus the mean of `right`, drawn independently of each other.
#[must_use]
pub fn difference_interval(left: &[f64], right: &[f64], seed: u64) -> Option<Interval> {
    if left.len() < 2 || right.len() < 2 {
        return None;
    }
    let streams = [Draws::from_seed(seed, "report/left"), Draws::from_seed(seed, "report/right")];
    let mut picks = [vec![0usize; left.len()], vec![0usize; right.len()]];
    let differences = (0..RESAMPLES).filter_map(|resample| {
        let mut means = [left, right].into_iter().zip(&mut picks).zip(&streams).map(|((values, picks), draws)| {
            pick(picks, resample, draws);
            mean(picks.iter().map(|&index| values[index]))
        });
        Some(means.next()?? - means.next()??)
    });
    percentiles(differences.collect())
}

fn pick(picks: &mut [usize], resample: u64, draws: &Draws) {
    let count = picks.len() as u64;
    for (position, pick) in (0u64..).zip(picks) {
        *pick = usize::try_from(draws.below(resample * count + position, count)).expect("below a length in memory");
    }
}

fn percentiles(mut means: Vec<f64>) -> Option<Interval> {
    means.sort_by(f64::total_cmp);
    let tail = (1.0 - CONFIDENCE) / 2.0;
    Some(Interval { low: quantile(&means, tail)?, high: quantile(&means, 1.0 - tail)? })
}

/// Returns a quantile of sorted values, interpolated linearly (definition 7 of Hyndman and Fan 1996).
#[must_use]
pub fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let place = share.clamp(0.0, 1.0) * last as f64;
    let below = (place.floor() as usize).min(last);
    let above = (below + 1).min(last);
    Some(sorted[below] + (sorted[above] - sorted[below]) * (place - below as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_interpolate() {
        let sorted = [1.0, 2.0, 4.0, 8.0];
        for (share, expected) in [(0.0, 1.0), (0.5, 3.0), (1.0, 8.0), (0.25, 1.75), (0.9, 6.8)] {
            let found = quantile(&sorted, share).expect("values");
            assert!((found - expected).abs() < 1e-12, "quantile {share} is {found}, not {expected}");
        }
        assert_eq!(quantile(&[], 0.5), None);
    }

    #[test]
    fn too_few_values_have_no_interval() {
        assert_eq!(mean_interval(&[], &draws(1)), None);
        assert_eq!(mean_interval(&[0.5], &draws(1)), None);
        let columns = [vec![Some(0.5), None, None], vec![Some(0.5), None, Some(0.5)]];
        assert_eq!(mean_intervals(&columns, &draws(1)), [None, Some(Interval { low: 0.5, high: 0.5 })]);
        assert_eq!(difference_interval(&[1.0], &[0.0, 0.0], 1), None);
    }

    #[test]
    fn two_values_give_their_range() {
        // The three possible means are 0, 1/2 and 1, of probability 1/4, 1/2, 1/4: both tails are wider than 2.5 %.
        assert_eq!(mean_interval(&[0.0, 1.0], &draws(3)), Some(Interval { low: 0.0, high: 1.0 }));
    }

    #[test]
    fn the_seed_decides_the_interval() {
        let values: Vec<f64> = (0..30).map(|i| f64::from(i * i % 17) / 17.0).collect();
        assert_eq!(mean_interval(&values, &draws(5)), mean_interval(&values, &draws(5)));
        assert_ne!(mean_interval(&values, &draws(5)), mean_interval(&values, &draws(6)));
    }

    /// Of 200 samples of 40 uniform numbers, about 95 % of the intervals hold 1/2 (binomial: 3 standard deviations
    /// are 4.6 %; the percentile method covers slightly less than it says).
    #[test]
    fn intervals_cover_the_true_mean() {
        let source = Draws::from_seed(11, "uniform samples");
        let covered = (0u64..200)
            .filter(|sample| {
                let values: Vec<f64> = (0..40).map(|i| source.uniform(sample * 40 + i)).collect();
                let interval = mean_interval(&values, &draws(*sample)).expect("40 values");
                (interval.low..=interval.high).contains(&0.5)
            })
            .count();
        assert!((178..=199).contains(&covered), "{covered} of 200 intervals hold the mean");
    }

    /// The interval of a mean of n normal numbers is close to ±1.96 σ/√n.
    #[test]
    fn the_width_is_that_of_the_normal_approximation() {
        let source = Draws::from_seed(12, "normal samples");
        let values: Vec<f64> = (0..400).map(|i| source.normal(i)).collect();
        let width = |interval: Interval| interval.high - interval.low;
        let one = width(mean_interval(&values, &draws(1)).expect("400 values"));
        assert!((one / (2.0 * 1.96 / 20.0) - 1.0).abs() < 0.12, "width {one}");
        let two = width(difference_interval(&values[..200], &values[200..], 1).expect("200 values each"));
        assert!((two / (2.0 * 1.96 / 10.0) - 1.0).abs() < 0.15, "width {two}");
    }
}

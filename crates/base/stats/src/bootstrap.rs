//! The bootstrap: units (scenarios, agents, frames) drawn with replacement, or blocks of neighbouring windows within
//! their drive; percentile intervals of means (Efron and Tibshirani 1993, chapter 13; blocks: Künsch 1989).
//!
//! Draws are a function of stream, resample and position, so the same units are drawn for every figure over the same
//! number of units. Below five units such intervals are too narrow.

use ds_space::Draws;

use crate::mean;
use crate::quantile::percentiles;

/// Returns which of `count` units a resample takes, as many as there are; `first` is the index of its first draw.
#[must_use]
pub fn pick(draws: &Draws, first: u64, count: usize) -> Vec<usize> {
    (first..).take(count).map(|index| draws.below(index, count as u64) as usize).collect()
}

/// Returns the picks of `times` resamples of `count` units.
pub fn resamples(draws: &Draws, times: u64, count: usize) -> impl Iterator<Item = Vec<usize>> {
    let draws = *draws;
    (0..times).map(move |resample| pick(&draws, resample * count as u64, count))
}

/// Returns how often each window counts in each of `times` resamples; `drives[w]` is the drive of window `w`, drives are
/// contiguous. Blocks of `block` windows are drawn within a drive, round its end, so that every drive keeps its size.
#[must_use]
pub fn block_weights(drives: &[usize], block: usize, times: u64, draws: &Draws) -> Vec<Vec<f64>> {
    let spans = spans(drives);
    let mut counter = 0;
    (0..times).map(|_| blocks(&spans, drives.len(), block, draws, &mut counter)).collect()
}

/// Returns the same in two stages: as many drives as there are, with replacement, and blocks within each of them. A single
/// drive is all that is drawn of one.
#[must_use]
pub fn staged_weights(drives: &[usize], block: usize, times: u64, draws: &Draws) -> Vec<Vec<f64>> {
    let spans = spans(drives);
    let mut counter = 0;
    let one = |_| {
        let picked: Vec<(usize, usize)> = pick(draws, counter, spans.len()).into_iter().map(|k| spans[k]).collect();
        counter += spans.len() as u64;
        blocks(&picked, drives.len(), block, draws, &mut counter)
    };
    (0..times).map(one).collect()
}

/// Returns first and one past the last window of each drive.
fn spans(drives: &[usize]) -> Vec<(usize, usize)> {
    let mut spans: Vec<(usize, usize)> = Vec::new();
    for (k, drive) in drives.iter().enumerate() {
        match spans.last_mut() {
            Some(span) if drives[span.0] == *drive => span.1 = k + 1,
            _ => spans.push((k, k + 1)),
        }
    }
    spans
}

/// Draws blocks within some drives; tells how often each of `count` windows was drawn.
fn blocks(spans: &[(usize, usize)], count: usize, block: usize, draws: &Draws, counter: &mut u64) -> Vec<f64> {
    let mut weights = vec![0.0; count];
    for &(start, end) in spans {
        let count = end - start;
        // two blocks at least, or nothing would be drawn anew
        let block = block.min(count / 2).max(1);
        let mut drawn = 0;
        while drawn < count {
            let first = (draws.uniform(*counter) * count as f64) as usize;
            *counter += 1;
            for k in 0..block.min(count - drawn) {
                weights[start + (first + k) % count] += 1.0;
            }
            drawn += block;
        }
    }
    weights
}

/// Returns the interval of a ratio of sums over units, each a pair of what is summed above and below the line: values and
/// their count (the mean over clusters that are drawn whole), events and kilometres. `tail` is the share beyond either end.
///
/// Resamples whose lower sum is 0 say nothing. Fewer than two units have no interval.
#[must_use]
pub fn ratio(units: &[(f64, f64)], picks: &[Vec<usize>], tail: f64) -> Option<[f64; 2]> {
    if units.len() < 2 {
        return None;
    }
    let sums = |picks: &Vec<usize>| {
        picks.iter().fold((0.0, 0.0), |(above, below), &unit| (above + units[unit].0, below + units[unit].1))
    };
    let ratios = picks.iter().map(sums).filter(|(_, below)| *below > 0.0).map(|(above, below)| above / below);
    percentiles(ratios.collect(), tail)
}

/// How intervals of means are drawn.
#[derive(Debug, Clone, Copy)]
pub struct MeanBootstrap {
    /// Resamples.
    pub times: u64,
    /// Share of the resampled means that lies beyond either end.
    pub tail: f64,
}

impl MeanBootstrap {
    /// Returns an interval for the mean of each column; columns have one entry per unit, `None` where the unit has no
    /// value. All columns of a unit are drawn together.
    ///
    /// A column with fewer than two values has no interval. All columns must have the same length.
    #[must_use]
    pub fn means(&self, columns: &[Vec<Option<f64>>], draws: &Draws) -> Vec<Option<[f64; 2]>> {
        let units = columns.first().map_or(0, Vec::len);
        assert!(columns.iter().all(|column| column.len() == units), "columns of one table have one length");
        if units < 2 {
            return vec![None; columns.len()];
        }
        let filled: Vec<Vec<(f64, f64)>> = columns
            .iter()
            .map(|column| column.iter().map(|value| value.map_or((0.0, 0.0), |value| (value, 1.0))).collect())
            .collect();
        let mut means: Vec<Vec<f64>> = vec![Vec::new(); columns.len()];
        for picks in resamples(draws, self.times, units) {
            for (column, means) in filled.iter().zip(&mut means) {
                let (mut sum, mut count) = (0.0, 0.0);
                for &unit in &picks {
                    sum += column[unit].0;
                    count += column[unit].1;
                }
                if count > 0.0 {
                    means.push(sum / count);
                }
            }
        }
        let enough = |column: &Vec<Option<f64>>| column.iter().flatten().count() >= 2;
        let ends = |(column, means)| enough(column).then(|| percentiles(means, self.tail)).flatten();
        columns.iter().zip(means).map(ends).collect()
    }

    /// Returns an interval for the mean of `left` minus the mean of `right`, each drawn from a stream of its own.
    #[must_use]
    pub fn difference(&self, [left, right]: [&[f64]; 2], streams: &[Draws; 2]) -> Option<[f64; 2]> {
        if left.len() < 2 || right.len() < 2 {
            return None;
        }
        let of = |values: &[f64], picks: Vec<usize>| mean(picks.into_iter().map(|index| values[index]));
        let pairs = resamples(&streams[0], self.times, left.len()).zip(resamples(&streams[1], self.times, right.len()));
        let differences = pairs.filter_map(|(a, b)| Some(of(left, a)? - of(right, b)?));
        percentiles(differences.collect(), self.tail)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAN: MeanBootstrap = MeanBootstrap { times: 2000, tail: 0.025 };

    fn draws(seed: u64) -> Draws {
        Draws::from_seed(seed, "bootstrap test")
    }

    fn one(values: &[f64], draws: &Draws) -> Option<[f64; 2]> {
        PLAN.means(&[values.iter().copied().map(Some).collect()], draws)[0]
    }

    #[test]
    fn every_block_draw_keeps_the_size_of_every_drive() {
        let drives = [0, 0, 0, 0, 0, 1, 1, 1, 1];
        for draw in block_weights(&drives, 3, 50, &draws(1)) {
            assert!((draw[..5].iter().sum::<f64>() - 5.0).abs() < 1e-12);
            assert!((draw[5..].iter().sum::<f64>() - 4.0).abs() < 1e-12);
        }
    }

    #[test]
    fn too_few_values_have_no_interval() {
        assert_eq!((one(&[], &draws(1)), one(&[0.5], &draws(1))), (None, None));
        let columns = [vec![Some(0.5), None, None], vec![Some(0.5), None, Some(0.5)]];
        assert_eq!(PLAN.means(&columns, &draws(1)), [None, Some([0.5, 0.5])]);
        assert_eq!(PLAN.difference([&[1.0], &[0.0, 0.0]], &[draws(1), draws(2)]), None);
    }

    #[test]
    fn whole_clusters_are_wider_where_their_members_agree() {
        let picks = |count| resamples(&draws(9), 2000, count).collect::<Vec<_>>();
        let single: Vec<(f64, f64)> = (0..40).map(|k| (f64::from(k / 4 % 2), 1.0)).collect();
        let clusters: Vec<(f64, f64)> = (0..10).map(|k| (4.0 * f64::from(k % 2), 4.0)).collect();
        let [low, high] = ratio(&single, &picks(40), 0.025).expect("40 units");
        let [wide_low, wide_high] = ratio(&clusters, &picks(10), 0.025).expect("10 units");
        assert!(wide_high - wide_low > 1.7 * (high - low), "{low} {high} {wide_low} {wide_high}");
        let values: Vec<f64> = single.iter().map(|(value, _)| *value).collect();
        let streams: Vec<Vec<usize>> = resamples(&draws(1), 2000, 40).collect();
        assert_eq!(ratio(&single, &streams, 0.025), one(&values, &draws(1)));
        assert_eq!(ratio(&single[..1], &picks(1), 0.025), None);
    }

    #[test]
    fn two_values_give_their_range() {
        // The three possible means are 0, 1/2 and 1, of probability 1/4, 1/2, 1/4: both tails are wider than 2.5 %.
        assert_eq!(one(&[0.0, 1.0], &draws(3)), Some([0.0, 1.0]));
    }

    #[test]
    fn the_seed_decides_the_interval() {
        let values: Vec<f64> = (0..30).map(|i| f64::from(i * i % 17) / 17.0).collect();
        assert_eq!(one(&values, &draws(5)), one(&values, &draws(5)));
        assert_ne!(one(&values, &draws(5)), one(&values, &draws(6)));
    }

    /// Of 200 samples of 40 uniform numbers, about 95 % of the intervals hold 1/2 (binomial: 3 standard deviations
    /// are 4.6 %; the percentile method covers slightly less than it says).
    #[test]
    fn intervals_cover_the_true_mean() {
        let source = Draws::from_seed(11, "uniform samples");
        let covered = (0u64..200)
            .filter(|sample| {
                let values: Vec<f64> = (0..40).map(|i| source.uniform(sample * 40 + i)).collect();
                let [low, high] = one(&values, &draws(*sample)).expect("40 values");
                (low..=high).contains(&0.5)
            })
            .count();
        assert!((178..=199).contains(&covered), "{covered} of 200 intervals hold the mean");
    }

    /// The interval of a mean of n normal numbers is close to ±1.96 σ/√n.
    #[test]
    fn the_width_is_that_of_the_normal_approximation() {
        let source = Draws::from_seed(12, "normal samples");
        let values: Vec<f64> = (0..400).map(|i| source.normal(i)).collect();
        let width = |[low, high]: [f64; 2]| high - low;
        let all = width(one(&values, &draws(1)).expect("400 values"));
        assert!((all / (2.0 * 1.96 / 20.0) - 1.0).abs() < 0.12, "width {all}");
        let two = PLAN.difference([&values[..200], &values[200..]], &[draws(1), draws(2)]);
        let two = width(two.expect("200 values each"));
        assert!((two / (2.0 * 1.96 / 10.0) - 1.0).abs() < 0.15, "width {two}");
    }
}

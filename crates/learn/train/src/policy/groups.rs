//! k-means: the centres of groups of rows of numbers.

use ds_space::Draws;

/// Rounds of moving the centres.
const ROUNDS: u32 = 60;

/// Returns the centres of so many groups. They begin at drawn rows, each at one drawn by the square of how far it lies
/// from those before (k-means++), then move to the means of what is nearest to them.
pub(super) fn centres<const N: usize>(points: &[[f32; N]], count: usize, seed: u64) -> Vec<[f32; N]> {
    let draws = Draws::from_seed(seed, "anchors");
    let mut centres: Vec<[f32; N]> = Vec::with_capacity(count);
    let mut squares = vec![f64::INFINITY; points.len()];
    for index in 0..count as u64 {
        let sum: f64 = squares.iter().filter(|square| square.is_finite()).sum();
        let mut left = draws.uniform(index) * sum;
        let at = squares.iter().position(|square| {
            left -= square;
            sum > 0.0 && left < 0.0
        });
        let at = at.unwrap_or_else(|| below(&draws, 1_000 + index, points.len()));
        centres.push(points[at]);
        let nearer = squares.iter_mut().zip(points);
        nearer.for_each(|(square, point)| *square = square.min(apart(point, &points[at])));
    }
    for _ in 0..ROUNDS {
        let mut sums = vec![([0.0f64; N], 0u32); count];
        for point in points {
            let (sum, number) = &mut sums[nearest(&centres, |centre| apart(centre, point))];
            sum.iter_mut().zip(point).for_each(|(sum, value)| *sum += f64::from(*value));
            *number += 1;
        }
        for (centre, (sum, number)) in centres.iter_mut().zip(sums).filter(|(_, (_, number))| *number > 0) {
            #[expect(clippy::cast_possible_truncation, reason = "weights are single precision")]
            centre.iter_mut().zip(sum).for_each(|(centre, sum)| *centre = (sum / f64::from(number)) as f32);
        }
    }
    centres
}

#[expect(clippy::cast_possible_truncation, reason = "below the number of points")]
fn below(draws: &Draws, index: u64, count: usize) -> usize {
    draws.below(index, count as u64) as usize
}

/// Returns the sum of squares between two rows.
fn apart<const N: usize>(one: &[f32; N], other: &[f32; N]) -> f64 {
    one.iter().zip(other).map(|(a, b)| f64::from(a - b).powi(2)).sum()
}

/// Returns the place of the nearest of some.
pub(super) fn nearest<T>(all: &[T], far: impl Fn(&T) -> f64) -> usize {
    (0..all.len()).min_by(|a, b| far(&all[*a]).total_cmp(&far(&all[*b]))).expect("there are some")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn centres_are_those_of_groups() {
        let draws = Draws::from_seed(3, "groups of plans");
        #[expect(clippy::cast_possible_truncation, reason = "made-up points")]
        let point = |index: u64| -> [f32; 16] {
            let group = (index % 4) as f32;
            std::array::from_fn(|k| 3.0 * group + 0.1 * draws.normal(16 * index + k as u64) as f32)
        };
        let points: Vec<_> = (0..200).map(point).collect();
        for seed in [1, 2] {
            let mut found = centres(&points, 4, seed);
            found.sort_by(|a, b| a[0].total_cmp(&b[0]));
            for (group, centre) in found.iter().enumerate() {
                assert!(centre.iter().all(|value| (value - 3.0 * group as f32).abs() < 0.1), "seed {seed}: {centre:?}");
            }
        }
        // Fewer rows than centres: every centre is one of them.
        assert!(centres(&points[..2], 5, 1).iter().all(|centre| points[..2].contains(centre)));
    }
}

//! The value of a set split over its members (Shapley 1953): the mean contribution over all orders of joining.

/// Splits the value of the full set over its members; `values[c]` is the value of the set of `c`'s bits, 2^n of them.
/// The parts sum to the value of the full set less that of the empty one.
#[must_use]
pub fn shapley(values: &[f64]) -> Vec<f64> {
    let count = values.len().trailing_zeros() as usize;
    let factorial = |n: usize| (1..=n).map(|k| k as f64).product::<f64>();
    (0..count)
        .map(|member| {
            let without = (0..values.len()).filter(|set| set & (1 << member) == 0);
            without
                .map(|set| {
                    let size = set.count_ones() as usize;
                    let weight = factorial(size) * factorial(count - size - 1) / factorial(count);
                    weight * (values[set | (1 << member)] - values[set])
                })
                .sum()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(values: &[f64], expected: &[f64]) {
        let shares = shapley(values);
        assert_eq!(shares.len(), expected.len());
        assert!(shares.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{shares:?}, not {expected:?}");
    }

    #[test]
    fn shares_sum_to_the_whole_and_follow_the_axioms() {
        // v(S) = 2·[0 in S] + 3·[1 in S] + 4·[0 and 1 in S]; member 2 does nothing.
        let value = |set: usize| {
            let has = |k: usize| f64::from(u8::from(set & (1 << k) != 0));
            2.0 * has(0) + 3.0 * has(1) + 4.0 * has(0) * has(1) + 1.0
        };
        check(&(0..8).map(value).collect::<Vec<_>>(), &[4.0, 5.0, 0.0]);
    }

    #[test]
    fn twins_share_alike() {
        // three players: the first two only work together, the third alone
        check(&[0.0, 0.0, 0.0, 0.6, 0.2, 0.2, 0.2, 0.8], &[0.3, 0.3, 0.2]);
    }
}

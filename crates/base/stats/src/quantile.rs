//! Quantiles by straight lines between order statistics (definition 7 of Hyndman and Fan 1996).

/// Returns a quantile of sorted values; nothing for no values.
#[must_use]
pub fn sorted_quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let last = sorted.len().checked_sub(1)?;
    let place = share.clamp(0.0, 1.0) * last as f64;
    let below = (place.floor() as usize).min(last);
    let above = (below + 1).min(last);
    Some(sorted[below] + (sorted[above] - sorted[below]) * (place - below as f64))
}

/// Sorts values and returns a quantile of them; NaN for no values.
#[must_use]
pub fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    sorted_quantile(values, share).unwrap_or(f64::NAN)
}

/// Returns the range that leaves a share `tail` of the values on either side; nothing for no values.
#[must_use]
pub fn percentiles(mut values: Vec<f64>, tail: f64) -> Option<[f64; 2]> {
    values.sort_by(f64::total_cmp);
    Some([sorted_quantile(&values, tail)?, sorted_quantile(&values, 1.0 - tail)?])
}

/// Sorts values and returns the middle one, the upper of two; nothing for no values.
#[must_use]
pub fn upper_median(values: &mut [f64]) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_interpolate() {
        let sorted = [1.0, 2.0, 4.0, 8.0];
        for (share, expected) in [(0.0, 1.0), (0.5, 3.0), (1.0, 8.0), (0.25, 1.75), (0.9, 6.8)] {
            let found = sorted_quantile(&sorted, share).expect("values");
            assert!((found - expected).abs() < 1e-12, "quantile {share} is {found}, not {expected}");
        }
        assert_eq!(sorted_quantile(&[], 0.5), None);
        assert!(quantile(&mut [], 0.5).is_nan());
        assert_eq!((upper_median(&mut [3.0, 1.0, 2.0, 4.0]), upper_median(&mut [])), (Some(3.0), None));
    }

    #[test]
    fn quantiles_of_a_ramp() {
        let mut values: Vec<f64> = (0..=100).rev().map(f64::from).collect();
        assert!((quantile(&mut values, 0.05) - 5.0).abs() < 1e-12);
        let [low, high] = percentiles(values, 0.05).expect("values");
        assert!((low - 5.0).abs() < 1e-12 && (high - 95.0).abs() < 1e-12);
    }
}

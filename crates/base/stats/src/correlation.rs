//! Correlations of two columns, and ranks with ties shared.

/// Returns Pearson's r; none where a column is constant or has a value that is no number.
#[must_use]
pub fn pearson(a: &[f64], b: &[f64]) -> Option<f64> {
    let count = a.len() as f64;
    let mean = |values: &[f64]| values.iter().sum::<f64>() / count;
    let (over, under) = (mean(a), mean(b));
    let sum = |of: &dyn Fn(f64, f64) -> f64| a.iter().zip(b).map(|(a, b)| of(a - over, b - under)).sum::<f64>();
    let r = sum(&|a, b| a * b) / (sum(&|a, _| a * a) * sum(&|_, b| b * b)).sqrt();
    Some(r).filter(|r| r.is_finite())
}

/// Returns Spearman's rank correlation.
#[must_use]
pub fn spearman(a: &[f64], b: &[f64]) -> Option<f64> {
    pearson(&ranks(a), &ranks(b))
}

/// Returns ranks from 0, those of equal values being their mean.
#[must_use]
pub fn ranks(values: &[f64]) -> Vec<f64> {
    let below = |value: f64| values.iter().filter(|other| **other < value).count() as f64;
    let equal = |value: f64| values.iter().filter(|other| **other == value).count() as f64;
    values.iter().map(|value| below(*value) + 0.5 * (equal(*value) - 1.0)).collect()
}

/// Returns the 95 % interval of a correlation over so many independent units (Fisher's z).
#[must_use]
pub fn fisher(r: f64, units: usize) -> Option<[f64; 2]> {
    let spread = 1.959_964 / ((units as f64) - 3.0).sqrt();
    let z = r.clamp(-0.999_999, 0.999_999).atanh();
    (units > 3).then(|| [(z - spread).tanh(), (z + spread).tanh()])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn correlations_by_hand() {
        let near = |found: Option<f64>, expected: f64| assert!(found.is_some_and(|f| (f - expected).abs() < 1e-9));
        near(pearson(&[1.0, 2.0, 3.0], &[6.0, 4.0, 2.0]), -1.0);
        near(pearson(&[0.0, 0.0, 1.0, 1.0], &[0.0, 1.0, 0.0, 1.0]), 0.0);
        near(spearman(&[1.0, 10.0, 100.0], &[1.0, 2.0, 2.5]), 1.0);
        assert_eq!(ranks(&[5.0, 1.0, 5.0]), [1.5, 0.0, 1.5]);
        assert_eq!(pearson(&[1.0, 1.0], &[1.0, 2.0]), None);
        // What the specification states for eight and sixteen sources.
        let close = |found: Option<[f64; 2]>, expected: [f64; 2]| {
            let found = found.expect("enough units");
            assert!((found[0] - expected[0]).abs() < 0.01 && (found[1] - expected[1]).abs() < 0.01, "{found:?}");
        };
        close(fisher(-0.65, 8), [-0.93, 0.10]);
        close(fisher(-0.65, 16), [-0.87, -0.23]);
        assert_eq!(fisher(0.5, 3), None);
    }
}

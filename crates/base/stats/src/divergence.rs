//! How far two histograms are apart.

/// Returns the Jensen–Shannon divergence of two histograms over the same bins, in nats: 0 for equal shares, ln 2 for disjoint
/// ones; nothing where one of them is empty.
#[must_use]
pub fn jensen_shannon(a: &[f64], b: &[f64]) -> Option<f64> {
    let (of_a, of_b) = (a.iter().sum::<f64>(), b.iter().sum::<f64>());
    let part = |share: f64, mean: f64| if share > 0.0 { 0.5 * share * (share / mean).ln() } else { 0.0 };
    let bin = |(a, b): (&f64, &f64)| {
        let (a, b) = (a / of_a, b / of_b);
        part(a, 0.5 * (a + b)) + part(b, 0.5 * (a + b))
    };
    (of_a > 0.0 && of_b > 0.0).then(|| a.iter().zip(b).map(bin).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn divergences_by_hand() {
        let check = |a: &[f64], b: &[f64], expected: f64| {
            let found = jensen_shannon(a, b).expect("not empty");
            assert!((found - expected).abs() < 1e-12, "{found}");
        };
        check(&[1.0, 3.0], &[2.0, 6.0], 0.0);
        check(&[5.0, 0.0], &[0.0, 1.0], std::f64::consts::LN_2);
        // (1, 0) and (½, ½) around (¾, ¼): ½ ln 4/3 + ¼ ln 2/3 + ¼ ln 2.
        check(&[1.0, 0.0], &[1.0, 1.0], 0.5 * (4.0f64 / 3.0).ln() + 0.25 * (2.0f64 / 3.0).ln() + 0.25 * 2.0f64.ln());
        assert_eq!(jensen_shannon(&[0.0], &[1.0]), None);
    }
}

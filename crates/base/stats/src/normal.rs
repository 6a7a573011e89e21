//! The upper tail of the standard normal distribution, to twelve digits of the tail itself.

/// Terms of the continued fraction; at its nearest end sixteen digits need about fifty.
const TERMS: u32 = 100;
/// From here on the continued fraction, below it the series.
const FAR: f64 = 2.5;

/// Returns the probability that a standard normal number exceeds `z`: the series of Marsaglia (2004), far out the
/// continued fraction of Laplace. NaN for NaN.
#[must_use]
pub fn normal_tail(z: f64) -> f64 {
    if z < 0.0 {
        return 1.0 - normal_tail(-z);
    }
    let density = (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt();
    if z < FAR {
        let (mut term, mut sum, mut odd) = (z, z, 1.0);
        while term > 1e-17 * sum {
            odd += 2.0;
            term *= z * z / odd;
            sum += term;
        }
        return 0.5 - density * sum;
    }
    density / (1..=TERMS).rev().fold(z, |below, k| z + f64::from(k) / below)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of `scipy.stats.norm.sf`.
    #[test]
    fn equals_scipy() {
        let rows = [
            (0.0, 0.5),
            (0.5, 0.308_537_538_725_986_9),
            (1.0, 0.158_655_253_931_457_05),
            (1.644_853_626_951_472_2, 0.05),
            (2.4, 0.008_197_535_924_596_13),
            (2.6, 0.004_661_188_023_718_75),
            (3.0, 0.001_349_898_031_630_094_6),
            (6.0, 9.865_876_450_376_98e-10),
            (10.0, 7.619_853_024_160_527e-24),
            (-1.0, 0.841_344_746_068_542_9),
        ];
        for (z, expected) in rows {
            let found = normal_tail(z);
            assert!((found / expected - 1.0).abs() < 1e-11, "{z}: {found}, not {expected}");
        }
        assert!(normal_tail(f64::NAN).is_nan());
        assert_eq!((normal_tail(f64::INFINITY), normal_tail(f64::NEG_INFINITY)), (0.0, 1.0));
    }

    #[test]
    fn series_and_fraction_meet() {
        let (below, above) = (normal_tail(FAR - 1e-9), normal_tail(FAR));
        let slope = (-0.5 * FAR * FAR).exp() / std::f64::consts::TAU.sqrt();
        assert!((below - above - 1e-9 * slope).abs() < 1e-14, "{below} and {above}");
    }
}

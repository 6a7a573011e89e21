//! The upper tail of Student's t distribution, and spreads of few values each that borrow from one another (Smyth 2004).
//!
//! The tail is an integral over an angle: with t = √ν tan φ the density is proportional to cosᵛ⁻¹ φ.

use std::f64::consts::FRAC_PI_2;

/// Intervals of Simpson's rule.
const INTERVALS: u32 = 4000;

/// Returns the probability that a number of Student's distribution with `freedom` ≥ 1 degrees of freedom exceeds `t`.
/// NaN for NaN.
#[must_use]
pub fn student_tail(t: f64, freedom: f64) -> f64 {
    if t < 0.0 {
        return 1.0 - student_tail(-t, freedom);
    }
    let mass = |from: f64| {
        let step = (FRAC_PI_2 - from) / f64::from(INTERVALS);
        let at = |k: u32| (from + step * f64::from(k)).cos().max(0.0).powf(freedom - 1.0);
        let inner: f64 = (1..INTERVALS).map(|k| if k % 2 == 1 { 4.0 * at(k) } else { 2.0 * at(k) }).sum();
        step / 3.0 * (at(0) + inner + at(INTERVALS))
    };
    0.5 * mass((t / freedom.sqrt()).atan()) / mass(0.0)
}

/// What many samples of few values each say together of how far one of them may vary.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pooled {
    /// Degrees of freedom that the common spread is worth in each sample.
    pub freedom: f64,
    /// Common variance.
    pub variance: f64,
}

impl Pooled {
    /// Pools samples of `count` values each by the moments of the logarithm of their variances; at most `count` - 1 degrees
    /// of freedom are borrowed. Variances of nil count as a millionth of the median.
    #[must_use]
    pub fn of(variances: &[f64], count: usize) -> Self {
        let own = (count.max(2) - 1) as f64;
        let mut sorted: Vec<f64> = variances.iter().copied().filter(|v| v.is_finite()).collect();
        if sorted.is_empty() {
            return Self { freedom: 0.0, variance: 0.0 };
        }
        let least = 1e-6 * crate::quantile(&mut sorted, 0.5).max(f64::MIN_POSITIVE);
        let shift = digamma(0.5 * own) - (0.5 * own).ln();
        let logs: Vec<f64> = sorted.iter().map(|v| v.max(least).ln() - shift).collect();
        let mean = logs.iter().sum::<f64>() / logs.len() as f64;
        let scatter = logs.iter().map(|l| (l - mean).powi(2)).sum::<f64>() / (logs.len() as f64 - 1.0).max(1.0);
        let excess = scatter - trigamma(0.5 * own);
        // trigamma falls: the more the variances differ beyond chance, the less is borrowed
        let borrowed = |excess: f64| {
            let (mut low, mut high) = (1e-3, 1e4);
            for _ in 0..60 {
                let middle: f64 = 0.5 * (low + high);
                if trigamma(0.5 * middle) > excess { low = middle } else { high = middle }
            }
            0.5 * (low + high)
        };
        let freedom = if excess > 0.0 { borrowed(excess).min(own) } else { own };
        Self { freedom, variance: (mean + digamma(0.5 * freedom) - (0.5 * freedom).ln()).exp() }
    }

    /// Returns the probability that a further value of a sample exceeds `value` by chance.
    #[must_use]
    pub fn exceeds(&self, sample: &[f64], value: f64) -> f64 {
        let count = sample.len() as f64;
        if sample.is_empty() {
            return 1.0;
        }
        let mean = sample.iter().sum::<f64>() / count;
        let squares: f64 = sample.iter().map(|v| (v - mean).powi(2)).sum();
        let freedom = (self.freedom + count - 1.0).max(1.0);
        let spread = ((self.freedom * self.variance + squares) / freedom * (1.0 + 1.0 / count)).sqrt();
        student_tail((value - mean) / spread.max(1e-12), freedom)
    }
}

/// Returns the derivative of the logarithm of the gamma function, for positive arguments.
fn digamma(x: f64) -> f64 {
    if x < 6.0 {
        return digamma(x + 1.0) - 1.0 / x;
    }
    let y = 1.0 / (x * x);
    x.ln() - 0.5 / x - y * (1.0 / 12.0 - y * (1.0 / 120.0 - y / 252.0))
}

/// Returns the second derivative of the logarithm of the gamma function, for positive arguments.
fn trigamma(x: f64) -> f64 {
    if x < 6.0 {
        return trigamma(x + 1.0) + 1.0 / (x * x);
    }
    let y = 1.0 / (x * x);
    1.0 / x + 0.5 * y + y / x * (1.0 / 6.0 - y * (1.0 / 30.0 - y / 42.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of `scipy.stats.t.sf`.
    #[test]
    fn equals_scipy() {
        let rows = [
            (0.0, 3.0, 0.5),
            (1.0, 1.0, 0.25),
            (2.0, 4.0, 0.058_058_261_758_408),
            (5.6, 4.0, 0.002_496_071_589_605),
            (3.0, 18.0, 0.003_842_706_070_157),
            (10.0, 9.0, 1.789_118_715_962e-6),
            (-1.5, 7.0, 0.911_350_756_505),
        ];
        for (t, freedom, expected) in rows {
            let found = student_tail(t, freedom);
            assert!((found / expected - 1.0).abs() < 1e-6, "{t} {freedom}: {found}, not {expected}");
        }
        assert!(student_tail(f64::NAN, 3.0).is_nan());
    }

    /// Values of `scipy.special.digamma` and `polygamma(1, x)`.
    #[test]
    fn gamma_derivatives_equal_scipy() {
        for (x, first, second) in [
            (0.5, -1.963_510_026_021_4, 4.934_802_200_544_7),
            (1.5, 0.036_489_973_978_6, 0.934_802_200_544_7),
            (9.0, 2.140_641_477_955_6, 0.117_512_014_694),
        ] {
            assert!((digamma(x) - first).abs() < 1e-6, "{x}: {}", digamma(x));
            assert!((trigamma(x) - second).abs() < 1e-6, "{x}: {}", trigamma(x));
        }
    }

    #[test]
    fn equal_spreads_are_borrowed_and_unequal_ones_are_not() {
        // variances of three values each, as chance makes them of one spread, and of spreads that differ a thousandfold
        let alike = Pooled::of(&[0.05, 0.3, 0.7, 1.0, 1.4, 2.3, 4.0], 3);
        assert_eq!(alike.freedom, 2.0);
        assert!((0.5..2.5).contains(&alike.variance), "{alike:?}");
        let apart = Pooled::of(&[1e-4, 1e-2, 1.0, 1e2, 1e4], 3);
        assert!(apart.freedom < 0.5, "{apart:?}");
    }

    #[test]
    fn what_exceeds_few_values_needs_to_be_far_off() {
        let pooled = Pooled { freedom: 2.0, variance: 1.0 };
        let sample = [-1.0, 0.0, 1.0];
        // t = 5 / √(4/3) with 4 degrees of freedom
        let expected = student_tail(5.0 / (4.0f64 / 3.0).sqrt(), 4.0);
        assert!((pooled.exceeds(&sample, 5.0) - expected).abs() < 1e-9);
        assert!(pooled.exceeds(&sample, 2.0) > 0.05);
        assert_eq!(pooled.exceeds(&[], 9.0), 1.0);
    }
}

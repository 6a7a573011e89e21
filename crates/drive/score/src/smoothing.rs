//! Savitzky–Golay filters as SciPy computes them: least-squares polynomials over a sliding window, or their derivatives.
//!
//! The first and last half windows are read off the polynomials of the first and last window ("interp"). An even window
//! is evaluated half a sample after its fourth of eight samples, which shifts it: a quirk that the references have.

use ds_space::angle::turn;

use crate::constants::comfort::ROUNDING;

/// The coefficients of one filter.
#[derive(Debug, Clone)]
pub(crate) struct Smoother {
    window: usize,
    inner: Vec<f64>,
    /// One row of coefficients for each of the first `window / 2` values; then the same for the last.
    edges: Vec<f64>,
}

impl Smoother {
    /// Makes a filter of a window (samples), polynomial order, derivative and sample distance (seconds).
    pub(crate) fn new(window: usize, order: usize, derivative: usize, dt_s: f64) -> Self {
        let basis = orthonormal_basis(window, order);
        let scale = dt_s.powi(-i32::try_from(derivative).unwrap_or(0));
        let middle = (window as f64 - 1.0) / 2.0;
        let row = |at: f64| -> Vec<f64> {
            let gains: Vec<f64> = basis.iter().map(|one| scale * evaluate(one, at, derivative)).collect();
            (0..window)
                .map(|j| basis.iter().zip(&gains).map(|(one, gain)| gain * evaluate(one, j as f64 - middle, 0)).sum())
                .collect()
        };
        let half = window / 2;
        let edges = (0..half).chain(window - half..window).flat_map(|position| row(position as f64 - middle)).collect();
        Self { window, inner: row(0.0), edges }
    }

    /// Filters a series of at least `window` values into `out`, of the same length.
    pub(crate) fn filter(&self, series: &[f64], out: &mut [f64]) {
        let (n, half) = (series.len(), self.window / 2);
        debug_assert!(n >= self.window && out.len() == n, "the filter was made for a shorter series");
        let first = half;
        let count = n - 2 * half;
        let inner = &mut out[first..first + count];
        inner.fill(0.0);
        // Even windows hold the samples i − w/2 + 1 ..= i + w/2.
        let lead = half - (self.window + 1) % 2;
        for (j, coefficient) in self.inner.iter().enumerate() {
            let from = first + j - lead;
            for (value, sample) in inner.iter_mut().zip(&series[from..from + count]) {
                *value += coefficient * sample;
            }
        }
        let (head, tail) = (&series[..self.window], &series[n - self.window..]);
        for (position, row) in self.edges.chunks_exact(self.window).enumerate() {
            let (at, samples) = if position < half { (position, head) } else { (n - 2 * half + position, tail) };
            out[at] = row.iter().zip(samples).map(|(a, b)| a * b).sum();
        }
    }
}

/// Returns polynomials (coefficients by rising power) that are orthonormal over the centred samples of a window.
fn orthonormal_basis(window: usize, order: usize) -> Vec<Vec<f64>> {
    let middle = (window as f64 - 1.0) / 2.0;
    let product = |a: &[f64], b: &[f64]| -> f64 {
        (0..window).map(|j| evaluate(a, j as f64 - middle, 0) * evaluate(b, j as f64 - middle, 0)).sum()
    };
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for degree in 0..=order {
        let mut one = vec![0.0; order + 1];
        one[degree] = 1.0;
        // Twice is enough to be orthogonal to rounding.
        for _ in 0..2 {
            for other in &basis {
                let share = product(&one, other);
                one.iter_mut().zip(other).for_each(|(a, b)| *a -= share * b);
            }
        }
        let norm = product(&one, &one).sqrt();
        one.iter_mut().for_each(|a| *a /= norm);
        basis.push(one);
    }
    basis
}

fn evaluate(coefficients: &[f64], at: f64, derivative: usize) -> f64 {
    (derivative..coefficients.len()).rev().fold(0.0, |value, power| {
        let factor: f64 = (power - derivative + 1..=power).map(|k| k as f64).product();
        value * at + factor * coefficients[power]
    })
}

/// Rounds to the decimals of the reference, halves to even.
pub(crate) fn round(values: &mut [f64]) {
    for value in values {
        *value = (*value * ROUNDING).round_ties_even() / ROUNDING;
    }
}

/// Makes a series of headings continuous.
pub(crate) fn unwrap(headings: &mut [f64]) {
    for i in 1..headings.len() {
        headings[i] = headings[i - 1] + turn(headings[i - 1], headings[i]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_even_window_is_evaluated_half_a_sample_late() {
        let smoother = Smoother::new(8, 2, 0, 0.1);
        let expected = [-3.0, 3.0, 7.0, 9.0, 9.0, 7.0, 3.0, -3.0];
        for (got, expected) in smoother.inner.iter().zip(expected) {
            assert!((got - expected / 32.0).abs() < 1e-14, "{:?}", smoother.inner);
        }
        // A ramp: half a sample ahead inside, true at both edges.
        let ramp: Vec<f64> = (0..20).map(f64::from).collect();
        let mut out = vec![0.0; 20];
        smoother.filter(&ramp, &mut out);
        for (i, got) in out.iter().enumerate() {
            let expected = if (4..16).contains(&i) { i as f64 + 0.5 } else { i as f64 };
            assert!((got - expected).abs() < 1e-12, "{i}: {got}");
        }
    }

    #[test]
    fn coefficients_of_the_text_books() {
        for (window, order, derivative, scale, expected) in [
            (5, 2, 1, 10.0, vec![-2.0, -1.0, 0.0, 1.0, 2.0]),
            (5, 3, 2, 7.0, vec![2.0, -1.0, -2.0, -1.0, 2.0]),
            (7, 2, 0, 21.0, vec![-2.0, 3.0, 6.0, 7.0, 6.0, 3.0, -2.0]),
        ] {
            let smoother = Smoother::new(window, order, derivative, 1.0);
            for (got, expected) in smoother.inner.iter().zip(expected) {
                assert!((got - expected / scale).abs() < 1e-13, "{window} {order} {derivative}: {:?}", smoother.inner);
            }
        }
    }

    proptest! {
        #[test]
        fn polynomials_pass_unchanged(
            a in -3.0..3.0f64, b in -3.0..3.0f64, c in -3.0..3.0f64, n in 15usize..60, half in 2usize..7,
        ) {
            let f = |t: f64| a + b * t + c * t * t;
            let series: Vec<f64> = (0..n).map(|i| f(i as f64 * 0.1)).collect();
            let mut out = vec![0.0; n];
            Smoother::new(2 * half + 1, 2, 0, 0.1).filter(&series, &mut out);
            for (i, got) in out.iter().enumerate() {
                prop_assert!((got - series[i]).abs() < 1e-9);
            }
            Smoother::new(2 * half + 1, 2, 1, 0.1).filter(&series, &mut out);
            for (i, got) in out.iter().enumerate() {
                prop_assert!((got - (b + 2.0 * c * i as f64 * 0.1)).abs() < 1e-8);
            }
        }
    }
}

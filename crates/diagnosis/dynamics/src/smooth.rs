//! Local quadratic fits to evenly sampled signals (Savitzky and Golay 1964): the state a window starts from.

/// Returns the value at sample `at` of the least-squares parabola through the samples within `half` of it.
///
/// Near the ends the parabola uses the samples that are there.
#[must_use]
pub fn parabola(signal: &[f64], at: usize, half: usize) -> f64 {
    let low = at.saturating_sub(half);
    let high = (at + half).min(signal.len() - 1);
    let mut moments = [0.0; 5];
    let mut sums = [0.0; 3];
    for (k, value) in signal.iter().enumerate().take(high + 1).skip(low) {
        let u = k as f64 - at as f64;
        let powers = [1.0, u, u * u];
        for (i, p) in powers.iter().enumerate() {
            sums[i] += p * value;
        }
        for (m, p) in moments.iter_mut().zip([1.0, u, u * u, u * u * u, u * u * u * u]) {
            *m += p;
        }
    }
    let matrix = nalgebra::Matrix3::from_fn(|i, j| moments[i + j]);
    let right = nalgebra::Vector3::from(sums);
    matrix.lu().solve(&right).map_or(signal[at], |solution| solution[0])
}

/// Returns the straight-line interpolation of an even signal at a fractional sample, held at the ends.
#[must_use]
pub fn between(signal: &[f64], at: f64) -> f64 {
    let last = signal.len() - 1;
    let at = at.clamp(0.0, last as f64);
    let low = (at as usize).min(last);
    let high = (low + 1).min(last);
    signal[low] + (at - low as f64) * (signal[high] - signal[low])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_kept() {
        let signal: Vec<f64> = (0..40).map(|k| 1.0 + 0.3 * f64::from(k) - 0.02 * f64::from(k * k)).collect();
        for at in [0, 3, 20, 39] {
            assert!((parabola(&signal, at, 5) - signal[at]).abs() < 1e-9);
        }
        assert!((between(&signal, 10.5) - 0.5 * (signal[10] + signal[11])).abs() < 1e-12);
    }
}

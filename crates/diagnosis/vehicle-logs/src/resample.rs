//! What becomes of a column on the 20 Hz grid beside lines and means: commands in force, angles without jumps, slopes.

/// Returns commands on an even grid: the last value at or before each point.
pub(crate) fn held(t: &[f64], column: &[f64], start_secs: f64, step_secs: f64, samples: usize) -> Vec<f64> {
    let known: Vec<usize> = (0..t.len()).filter(|&k| column[k].is_finite()).collect();
    let mut low = 0;
    (0..samples)
        .map(|k| {
            let now = start_secs + k as f64 * step_secs + 1e-9;
            while low + 1 < known.len() && t[known[low + 1]] <= now {
                low += 1;
            }
            known.get(low).map_or(f64::NAN, |&j| column[j])
        })
        .collect()
}

/// Takes the jumps of a full turn out of an angle.
pub(crate) fn unwrap(angle: &mut [f64]) {
    let mut last = f64::NAN;
    for value in angle.iter_mut().filter(|v| v.is_finite()) {
        if last.is_finite() {
            *value += ((last - *value) / std::f64::consts::TAU).round() * std::f64::consts::TAU;
        }
        last = *value;
    }
}

/// Returns the slope of a column per second by a straight line over ± 0.2 s.
pub(crate) fn slope(column: &[f64], step_secs: f64) -> Vec<f64> {
    let last = column.len().saturating_sub(1) as isize;
    let at = |k: isize| column[k.clamp(0, last) as usize];
    (0..=last)
        .map(|k| {
            let half = 4.min(k).min(last - k).max(1);
            let (mut cross, mut square) = (0.0, 0.0);
            for j in -half..=half {
                cross += j as f64 * at(k + j);
                square += (j * j) as f64;
            }
            // at the ends one of the two neighbours is the point itself
            let missing = if k == 0 || k == last { 2.0 } else { 1.0 };
            missing * cross / square / step_secs
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_is_held_and_a_slope_is_one_at_the_ends_too() {
        assert_eq!(held(&[0.0, 0.1, 0.2], &[0.0, 1.0, 0.0], 0.0, 0.05, 5), vec![0.0, 0.0, 1.0, 1.0, 0.0]);
        let ramp: Vec<f64> = (0..30).map(|k| 0.1 + f64::from(k) * 0.05).collect();
        assert!(slope(&ramp, 0.05).iter().all(|slope| (slope - 1.0).abs() < 1e-9));
    }
}

//! Brings a column of any rate onto the 20 Hz grid: measurements without aliasing, commands as the value in force.

/// Returns measurements on an even grid: the mean over one step of the grid where the log is faster (so that what lies
/// above half its rate is not folded down, and nothing is shifted in time), straight lines where it is slower.
pub(crate) fn measured(t: &[f64], column: &[f64], start_secs: f64, step_secs: f64, samples: usize) -> Vec<f64> {
    let known: Vec<usize> = (0..t.len()).filter(|&k| column[k].is_finite()).collect();
    if known.is_empty() {
        return vec![f64::NAN; samples];
    }
    let (mut low, mut first) = (0, 0);
    (0..samples)
        .map(|k| {
            let now = start_secs + k as f64 * step_secs;
            while first < known.len() && t[known[first]] < now - 0.5 * step_secs {
                first += 1;
            }
            let inside = known[first..].iter().take_while(|&&j| t[j] < now + 0.5 * step_secs);
            let (count, sum, centre) =
                inside.fold((0.0, 0.0, 0.0), |(n, s, c), &j| (n + 1.0, s + column[j], c + t[j] - now));
            // a mean stands for the grid point only if its samples lie around it
            if count > 1.5 && f64::abs(centre / count) < 0.2 * step_secs {
                return sum / count;
            }
            while low + 1 < known.len() && t[known[low + 1]] <= now {
                low += 1;
            }
            let (a, b) = (known[low], known[(low + 1).min(known.len() - 1)]);
            if a == b || now <= t[a] {
                return column[a];
            }
            column[a] + (now - t[a]) / (t[b] - t[a]) * (column[b] - column[a])
        })
        .collect()
}

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
    fn a_fast_ripple_vanishes_and_a_ramp_stays() {
        let t: Vec<f64> = (0..1000).map(|k| f64::from(k) * 0.002).collect();
        let column: Vec<f64> = t.iter().map(|t| t + 0.3 * (2.0 * std::f64::consts::PI * 100.0 * t).sin()).collect();
        let even = measured(&t, &column, 0.1, 0.05, 30);
        assert!(even.iter().enumerate().all(|(k, v)| (v - 0.1 - k as f64 * 0.05).abs() < 2e-2), "{even:?}");
        assert!((slope(&even, 0.05)[10] - 1.0).abs() < 0.02);
    }

    #[test]
    fn a_slow_log_is_joined_by_lines_and_a_command_is_held() {
        let (t, column) = ([0.0, 0.1, 0.2], [0.0, 1.0, 0.0]);
        let even = measured(&t, &column, 0.0, 0.05, 5);
        assert!((even[1] - 0.5).abs() < 1e-9 && (even[3] - 0.5).abs() < 1e-9);
        assert_eq!(held(&t, &column, 0.0, 0.05, 5), vec![0.0, 0.0, 1.0, 1.0, 0.0]);
    }
}

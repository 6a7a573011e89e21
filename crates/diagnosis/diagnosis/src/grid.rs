//! Columns of any rate on an even grid: straight lines between samples, and where a log is faster the mean over one step of
//! the grid, so that what lies above half its rate is not folded down and nothing is shifted in time.

/// Difference of stamps that is none, s.
const SAME_SECS: f64 = 1e-6;

/// Returns a column on an even grid by straight lines between the samples that are there.
#[must_use]
pub fn lines(t: &[f64], column: &[f64], start_secs: f64, step_secs: f64, samples: usize) -> Vec<f64> {
    let known = known(column);
    if known.is_empty() {
        return vec![f64::NAN; samples];
    }
    let mut at = 0;
    (0..samples)
        .map(|k| {
            let now = start_secs + k as f64 * step_secs;
            while at + 1 < known.len() && t[known[at + 1]] <= now + SAME_SECS {
                at += 1;
            }
            let (low, high) = (known[at], known[(at + 1).min(known.len() - 1)]);
            if high == low || (now - t[low]).abs() < SAME_SECS || now < t[low] {
                return column[low];
            }
            column[low] + (now - t[low]) / (t[high] - t[low]) * (column[high] - column[low])
        })
        .collect()
}

/// Returns a column on an even grid: the mean of the samples within half a step where there are several around the point,
/// straight lines elsewhere.
#[must_use]
pub fn means(t: &[f64], column: &[f64], start_secs: f64, step_secs: f64, samples: usize) -> Vec<f64> {
    let known = known(column);
    let mut first = 0;
    let mut even = lines(t, column, start_secs, step_secs, samples);
    for (k, value) in even.iter_mut().enumerate() {
        let now = start_secs + k as f64 * step_secs;
        while first < known.len() && t[known[first]] < now - 0.5 * step_secs {
            first += 1;
        }
        let inside = known[first..].iter().take_while(|&&j| t[j] < now + 0.5 * step_secs);
        let (count, sum, centre) =
            inside.fold((0.0, 0.0, 0.0), |(n, s, c), &j| (n + 1.0, s + column[j], c + t[j] - now));
        // a mean stands for the grid point only if its samples lie around it
        if count > 1.5 && f64::abs(centre / count) < 0.2 * step_secs {
            *value = sum / count;
        }
    }
    even
}

fn known(column: &[f64]) -> Vec<usize> {
    (0..column.len()).filter(|&k| column[k].is_finite()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fast_ripple_vanishes_and_a_ramp_stays() {
        let t: Vec<f64> = (0..1000).map(|k| f64::from(k) * 0.002).collect();
        let column: Vec<f64> = t.iter().map(|t| t + 0.3 * (2.0 * std::f64::consts::PI * 100.0 * t).sin()).collect();
        let even = means(&t, &column, 0.1, 0.05, 30);
        assert!(even.iter().enumerate().all(|(k, v)| (v - 0.1 - k as f64 * 0.05).abs() < 2e-2), "{even:?}");
    }

    #[test]
    fn a_slow_log_is_joined_by_lines_over_what_is_absent() {
        let (t, column) = ([0.0, 0.05, 0.1, 0.2], [0.0, f64::NAN, 1.0, 0.0]);
        for even in [lines(&t, &column, 0.0, 0.05, 5), means(&t, &column, 0.0, 0.05, 5)] {
            assert!((even[1] - 0.5).abs() < 1e-9 && (even[3] - 0.5).abs() < 1e-9, "{even:?}");
        }
        assert!(lines(&t, &[f64::NAN; 4], 0.0, 0.05, 2).iter().all(|v| v.is_nan()));
    }
}

//! Rows that come faster than the grid: the commands where they were sent, and channels that are slower than their rows as the
//! samples that they have of their own.

use ds_diagnosis::grid::lines;
use ds_diagnosis::table::STEP_SECS;

use crate::ego::FINE_SECS;

/// Rows a second from which on a log is faster than the grid.
pub(crate) const FAST_HZ: f64 = 30.0;
/// A value that stays for longer is one, and not the last sample of a slower channel, s.
const LONGEST_HELD_SECS: f64 = 1.0;

/// Returns a column without the values that only repeat the one before, whose age would look like a latency.
pub(super) fn own(t: &[f64], column: &[f64]) -> Vec<f64> {
    let mut own = column.to_vec();
    let mut first = 0;
    for held in column.chunk_by(|a, b| a == b) {
        let last = first + held.len() - 1;
        if t[last] - t[first] < LONGEST_HELD_SECS {
            own[first + 1..=last].fill(f64::NAN);
        }
        first += held.len();
    }
    own
}

/// Returns the share of its samples that a group of channels lacks, by how much longer than usual it waits for the next one.
pub(super) fn lost_share(t: &[f64], copied: &[bool]) -> f64 {
    let fresh: Vec<f64> = t.iter().zip(copied).filter(|(_, copied)| !**copied).map(|(t, _)| *t).collect();
    let mut steps: Vec<f64> = fresh.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if steps.is_empty() {
        return 0.0;
    }
    let usual = ds_stats::quantile(&mut steps, 0.5);
    let lost: f64 = steps.iter().map(|step| ((step / usual).round() - 1.0).max(0.0)).sum();
    lost / (lost + fresh.len() as f64)
}

/// Returns a command on the fine grid of so many samples of the grid.
pub(super) fn sent(t: &[f64], command: &[f64], samples: usize) -> Vec<f64> {
    lines(t, command, t[0], FINE_SECS, fine(samples - 1) + 1)
}

/// Returns the number of fine steps in some of the grid.
pub(super) fn fine(samples: usize) -> usize {
    samples * (STEP_SECS / FINE_SECS).round() as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(count: usize) -> Vec<f64> {
        (0..count).map(|k| k as f64 * 0.005).collect()
    }

    #[test]
    fn a_slower_channel_keeps_its_own_samples_and_a_constant_its_rows() {
        let t = rows(1000);
        let held: Vec<f64> = (0..1000).map(|k| (k / 10) as f64).collect();
        let fresh: Vec<usize> = (0..1000).filter(|k| !own(&t, &held)[*k].is_nan()).collect();
        assert_eq!(fresh, (0..1000).step_by(10).collect::<Vec<_>>());
        assert_eq!(own(&t, &[2.0; 1000]), vec![2.0; 1000]);
    }

    #[test]
    fn what_is_lost_is_told_from_what_is_slow() {
        let t = rows(2000);
        let slow: Vec<bool> = (0..2000).map(|k| k % 10 != 0).collect();
        assert_eq!(lost_share(&t, &slow), 0.0);
        let lossy: Vec<bool> = (0..2000).map(|k| k % 10 != 0 || k % 200 == 100).collect();
        assert!((lost_share(&t, &lossy) - 0.05).abs() < 1e-9, "{}", lost_share(&t, &lossy));
    }
}

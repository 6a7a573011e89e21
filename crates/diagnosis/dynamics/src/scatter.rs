//! Effects that change the scatter of samples, not their mean: jitter of the sampling instants and repeated samples.
//!
//! Jitter moves a sample along the path by speed times error, never across it: the second differences of position along
//! and across the heading have variances 6 (σ² + v² s²) and 6 σ². Repeats are exact copies of the sample before.

use crate::drive::Drive;
use crate::settings::{JITTER_SHARE, REPEAT_SURPRISE, SHAPE_ERROR};
use ds_diagnosis::table::STEP_SECS;

/// What was found in the scatter of some drives.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Scatter {
    /// Standard deviation of the sampling instants, s.
    pub jitter_secs: f64,
    /// Its standard error, s.
    pub jitter_error_secs: f64,
    /// Log evidence over the usual jitter.
    pub jitter_gain: f64,
    /// Share of repeated samples.
    pub repeated_share: f64,
    /// Its standard error.
    pub repeated_error: f64,
    /// Log evidence over no repeats.
    pub repeated_gain: f64,
}

/// Squared scale of the Student t law with four degrees of freedom that fits a normal law of variance one best: the root
/// of E[5 x² / (4 τ² + x²)] = 1.
const T_SCALE2: f64 = 0.69;
/// Jitter that any receiver has, s.
const ANY_SECS: f64 = 0.0025;
/// Step of the jitters that are tried, s.
const TRIED_SECS: f64 = 0.000_25;
/// The most jitter, s, and the largest share of repeated samples that are nothing of note.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerated {
    /// Standard deviation of the sampling instants, s.
    pub jitter_secs: f64,
    /// Share of repeated samples.
    pub repeated_share: f64,
}

impl Default for Tolerated {
    fn default() -> Self {
        Self { jitter_secs: ANY_SECS, repeated_share: 0.0 }
    }
}

/// Returns the scatter found in some drives, its evidence that beyond what is tolerated.
#[must_use]
pub fn scatter(drives: &[&Drive], tolerated: Tolerated) -> Scatter {
    let mut found = repeats(drives, tolerated.repeated_share);
    let mut pairs = Vec::new();
    for drive in drives {
        second_differences(drive, &mut pairs);
    }
    if pairs.len() < 100 {
        return found;
    }
    let noise2 = robust_variance(pairs.iter().map(|p| p.1)).max(1e-8);
    // maximum likelihood over a fine grid of s; neighbours share samples, so that only a share of the terms counts
    let likelihood = |s: f64| -> f64 {
        let term = |&(along, _, v): &(f64, f64, f64)| {
            let variance = noise2 + 6.0 * (v * s).powi(2);
            let z2 = along * along / (variance * T_SCALE2);
            -0.5 * variance.ln() - 2.5 * (1.0 + z2 / 4.0).ln()
        };
        JITTER_SHARE * pairs.iter().map(term).sum::<f64>()
    };
    let grid: Vec<f64> = (0..=120).map(|k| f64::from(k) * TRIED_SECS).collect();
    let values: Vec<f64> = grid.iter().map(|s| likelihood(*s)).collect();
    let best = (0..grid.len()).max_by(|a, b| values[*a].total_cmp(&values[*b])).unwrap_or(0);
    let inside: Vec<f64> =
        grid.iter().zip(&values).filter(|(_, v)| **v > values[best] - 0.5).map(|(s, _)| *s).collect();
    // samples that overflow tell nothing
    let (Some(low), Some(high)) = (inside.first(), inside.last()) else { return found };
    found.jitter_secs = grid[best];
    let width = 0.5 * (high - low);
    found.jitter_error_secs = width.max(TRIED_SECS).hypot(SHAPE_ERROR * found.jitter_secs);
    let within = tolerated.jitter_secs / TRIED_SECS;
    let ordinary = values.iter().take(within as usize + 1).copied().fold(f64::NEG_INFINITY, f64::max);
    found.jitter_gain = values[best] - ordinary + (found.jitter_error_secs / 0.03).ln();
    found
}

/// Returns the repeats of some drives; evidence is that of the copies over those that are usual, each worth no more than
/// chance makes it.
fn repeats(drives: &[&Drive], usual: f64) -> Scatter {
    let total: f64 = drives.iter().map(|d| d.samples as f64).sum::<f64>().max(1.0);
    let count: f64 = drives.iter().map(|d| d.repeated_share * d.samples as f64).sum();
    let share = count / total;
    let beyond = (count - usual * total).max(0.0);
    let term = |a: f64, b: f64| if a > 0.0 { a * (a / b).ln() } else { 0.0 };
    let by_chance = total * (term(share, usual) + term(1.0 - share, 1.0 - usual));
    let surprise = if beyond > 0.0 { (REPEAT_SURPRISE * beyond).min(by_chance) } else { 0.0 };
    Scatter {
        repeated_share: share,
        repeated_error: (share * (1.0 - share) / total).sqrt(),
        repeated_gain: surprise - 5.0,
        ..Scatter::default()
    }
}

/// Collects (along, across, speed) second differences of position at every sample that moves.
fn second_differences(drive: &Drive, out: &mut Vec<(f64, f64, f64)>) {
    let (Some(x), Some(y), Some(yaw), Some(speed)) = (&drive.x, &drive.y, &drive.yaw, drive.speed()) else { return };
    for k in 3..drive.samples.saturating_sub(3) {
        let v = speed[k];
        if v < 3.0 {
            continue;
        }
        let (sin, cos) = yaw[k].sin_cos();
        let second = |s: &[f64]| s[k + 1] - 2.0 * s[k] + s[k - 1];
        let accel = (speed[k + 3] - speed[k - 3]) / (6.0 * STEP_SECS);
        let turn = (yaw[k + 3] - yaw[k - 3]) / (6.0 * STEP_SECS) * v;
        let (dx, dy) = (second(x), second(y));
        let along = dx * cos + dy * sin - accel * STEP_SECS * STEP_SECS;
        let across = dy * cos - dx * sin - turn * STEP_SECS * STEP_SECS;
        out.push((along, across, v));
    }
}

/// Returns the standard deviation of the position's noise across the path, m, if the drive has positions.
#[must_use]
pub fn across_noise(drives: &[&Drive]) -> Option<f64> {
    let mut pairs = Vec::new();
    for drive in drives {
        second_differences(drive, &mut pairs);
    }
    (pairs.len() >= 100).then(|| (robust_variance(pairs.iter().map(|p| p.1)) / 6.0).sqrt())
}

fn robust_variance(values: impl Iterator<Item = f64>) -> f64 {
    let mut sizes: Vec<f64> = values.map(f64::abs).collect();
    sizes.sort_by(f64::total_cmp);
    (sizes[sizes.len() / 2] / 0.6745).powi(2)
}

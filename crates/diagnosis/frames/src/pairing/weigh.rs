//! Weighs effects by how much nearer they bring the statistics of a pair to those of effect-free pairs.
//!
//! Everything here is in units of the spread of effect-free pairs (see `Nuisance::root`), so that distances are plain
//! squares; an effect's gain is what it takes away. A gain counts where it exceeds the best gain that any effect has on an
//! effect-free pair that took no part in the mean.

use nalgebra::DVector;

use crate::pairing::paths::Path;
use crate::settings;

/// A place on a path.
#[derive(Debug, Clone)]
pub struct PathPoint {
    /// Number of the path.
    pub path: usize,
    /// Node before it and share of the way to the next.
    pub at: (usize, f64),
    /// What it takes away.
    pub gain: f64,
    /// Half width of the 90 % interval, as a share of the way along the path's values.
    pub error: f64,
}

impl PathPoint {
    /// Returns the values there.
    #[must_use]
    pub fn values(&self, paths: &[Path]) -> Vec<f64> {
        mix(&paths[self.path].values, self.at.0, self.at.1)
    }

    /// Returns the change of the statistics there.
    #[must_use]
    pub fn change(&self, paths: &[Path]) -> DVector<f64> {
        let (k, share) = self.at;
        let c = &paths[self.path].change;
        &c[k] + (&c[k + 1] - &c[k]) * share
    }
}

fn mix(nodes: &[Vec<f64>], k: usize, share: f64) -> Vec<f64> {
    nodes[k].iter().zip(&nodes[k + 1]).map(|(a, b)| a + share * (b - a)).collect()
}

/// Returns the best place of each path for a deviation from the mean.
#[must_use]
pub fn spots(paths: &[Path], deviation: &DVector<f64>) -> Vec<PathPoint> {
    let before = deviation.norm_squared();
    paths
        .iter()
        .enumerate()
        .map(|(number, path)| {
            let mut best = PathPoint { path: number, at: (0, 0.0), gain: 0.0, error: 0.0 };
            for k in 0..path.change.len() - 1 {
                let step = &path.change[k + 1] - &path.change[k];
                let from = deviation - &path.change[k];
                let bend = step.norm_squared();
                if bend < 1e-9 {
                    continue;
                }
                let share = (from.dot(&step) / bend).clamp(0.0, 1.0);
                let gain = before - (&from - &step * share).norm_squared();
                if gain > best.gain {
                    best = PathPoint { path: number, at: (k, share), gain, error: 1.645 / bend.sqrt() };
                }
            }
            best
        })
        .collect()
}

/// Returns the best gain that any effect has on a deviation.
#[must_use]
pub fn best(paths: &[Path], deviation: &DVector<f64>) -> f64 {
    spots(paths, deviation).iter().map(|s| s.gain).fold(0.0, f64::max)
}

/// Returns the gain that an effect must exceed: the best that any has on effect-free pairs, and the usual at least.
#[must_use]
pub fn needed(mut gains: Vec<f64>) -> f64 {
    let worst = if gains.is_empty() { 0.0 } else { ds_stats::quantile(&mut gains, 0.95) };
    (settings::NUISANCE_MARGIN * worst).max(settings::LEAST_PAIRING_GAIN)
}

/// Returns the squared distance that an effect-free pair may have.
#[must_use]
pub fn usual(mut sizes: Vec<f64>) -> f64 {
    if sizes.is_empty() { 60.0 } else { ds_stats::quantile(&mut sizes, 0.95) }
}

/// Lead over the gain of every other effect that is right in 95 of 100 pairs: gains that lie so far apart scatter against each
/// other by twice its root.
const LEAD: f64 = 10.8;

/// Returns the value of a path from which its gain reaches what is needed in 95 of 100 pairs (the generator's own gap
/// scatters by one along any direction), and leads over those of other effects; nothing where it never does.
#[must_use]
pub fn limit(path: &Path, needed: f64, others: &[Path]) -> Option<f64> {
    let needed = (needed.max(0.0).sqrt() + 1.645).powi(2);
    for k in 0..path.change.len() - 1 {
        for step in 1..=20 {
            let share = f64::from(step) / 20.0;
            let change = &path.change[k] + (&path.change[k + 1] - &path.change[k]) * share;
            let gain = change.norm_squared();
            if gain >= needed
                && (others.is_empty() || gain - best(others, &change) >= LEAD.max(settings::ROUGH_SIGNATURE * gain))
            {
                return Some(mix(&path.values, k, share)[0]);
            }
        }
    }
    None
}

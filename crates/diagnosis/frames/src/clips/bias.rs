//! What the generator does to a clip without any effect: a bias common to all clips, which effect-free clips tell, and the
//! spread of clips about it. Seeds share the bias, so that their scatter W says nothing of it; W is a part of the spread.

use nalgebra::{DMatrix, DVector};

use crate::clips::readout::COUNT;
use crate::pairing::nuisance::{inverse_root, least};
use crate::settings;

/// Bias and spread.
#[derive(Debug, Clone)]
pub struct Bias {
    /// The bias; without effect-free clips it is free.
    pub mean: Option<DVector<f64>>,
    /// Covariance of a clip's statistics about the bias.
    pub spread: DMatrix<f64>,
    /// Effect-free clips seen.
    pub clips: usize,
}

impl Bias {
    /// Learns from the statistics of effect-free clips, a row each.
    #[must_use]
    pub fn known(rows: &[&DVector<f64>]) -> Self {
        let n = rows.len() as f64;
        let keep = n / (n + settings::CLIP_SHRINKAGE);
        let (mean, mut spread) = moments(rows);
        for a in 0..COUNT {
            for b in (0..COUNT).filter(|b| *b != a) {
                spread[(a, b)] *= keep;
            }
            spread[(a, a)] = spread[(a, a)] * (n + 1.0) / (n - 1.0) + least(a).powi(2);
        }
        Self { mean: Some(mean), spread, clips: rows.len() }
    }

    /// Leaves the bias free; the spread is that of the clips of the case itself, the built-in one and the scatter of seeds.
    #[must_use]
    pub fn free(rows: &[&DVector<f64>], within: &DMatrix<f64>, seeds: usize) -> Self {
        let freedom = rows.len() as f64 - 1.0;
        let (_, own) = moments(rows);
        let share = 1.0 + 1.0 / seeds as f64;
        let variance = DVector::from_fn(COUNT, |k, _| {
            let built_in = least(k).powi(2) + share * within[(k, k)];
            (freedom * own[(k, k)] + settings::BUILT_IN_CLIPS * built_in) / (freedom + settings::BUILT_IN_CLIPS)
        });
        let spread = DMatrix::from_fn(COUNT, COUNT, |a, b| {
            let together = within[(a, b)] / (within[(a, a)] * within[(b, b)]).sqrt().max(1e-12);
            let correlation = if a == b { 1.0 } else { 0.5 * together };
            correlation * (variance[a] * variance[b]).sqrt()
        });
        Self { mean: None, spread, clips: 0 }
    }
}

impl Bias {
    /// Returns how much each clip counts: one that deviates far more than the others do is peculiar, whatever it shows.
    #[must_use]
    pub fn weights(&self, deviations: &[DVector<f64>]) -> Vec<f64> {
        let scale = inverse_root(self.spread.clone());
        let sizes: Vec<f64> = deviations.iter().map(|deviation| (&scale * deviation).norm()).collect();
        let most = settings::USUAL_CLIP * ds_stats::quantile(&mut sizes.clone(), 0.5);
        sizes.iter().map(|size| (most / size.max(1e-9)).min(1.0)).collect()
    }
}

/// Returns mean and covariance of some rows.
fn moments(rows: &[&DVector<f64>]) -> (DVector<f64>, DMatrix<f64>) {
    let n = rows.len() as f64;
    let mean = rows.iter().fold(DVector::zeros(COUNT), |sum, row| sum + *row) / n;
    let mut covariance = DMatrix::zeros(COUNT, COUNT);
    for row in rows {
        let d = *row - &mean;
        covariance += &d * d.transpose() / (n - 1.0).max(1.0);
    }
    (mean, covariance)
}

/// Returns the scatter of seeds about their clip's mean: W.
#[must_use]
pub fn within(clips: &[&[DVector<f64>]]) -> DMatrix<f64> {
    let mut sum = DMatrix::zeros(COUNT, COUNT);
    let mut freedom = 0.0;
    for rows in clips {
        let mean = rows.iter().fold(DVector::zeros(COUNT), |sum, row| sum + row) / rows.len() as f64;
        for row in *rows {
            let d = row - &mean;
            sum += &d * d.transpose();
        }
        freedom += rows.len() as f64 - 1.0;
    }
    sum / f64::max(freedom, 1.0)
}

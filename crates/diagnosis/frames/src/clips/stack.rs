//! The clips of a case as one vector in units of their spread.
//!
//! Where the bias is known, the vector is the mean of the clips. Where it is free, it is each clip against the mean of all,
//! and of the mean what differs between near and far: a bias is common to all distances but for a built-in spread.

use nalgebra::{DMatrix, DVector};

use crate::clips::bias::Bias;
use crate::clips::readout::COUNT;
use crate::pairing::layers::DISTANCES;
use crate::pairing::looks::ALL;
use crate::pairing::nuisance::inverse_root;
use crate::pairing::paths::Path;
use crate::settings;

/// Brings clips to units of their spread.
pub struct Stack {
    /// Weights of the clips in their mean; together 1.
    weights: Vec<f64>,
    /// What is looked at of the mean.
    mean: DMatrix<f64>,
    /// The scale of a clip about the mean, where that is looked at.
    clip: Option<DMatrix<f64>>,
}

impl Stack {
    /// Prepares for clips of some weights.
    #[must_use]
    pub fn new(bias: &Bias, weights: &[f64]) -> Self {
        let total: f64 = weights.iter().sum();
        let weights: Vec<f64> = weights.iter().map(|weight| weight / total).collect();
        let share: f64 = weights.iter().map(|weight| weight * weight).sum();
        if bias.mean.is_some() {
            let mean = inverse_root(&bias.spread * (share + 1.0 / bias.clips as f64));
            return Self { weights, mean, clip: None };
        }
        let apart = between_distances();
        let built_in = DMatrix::from_diagonal(&DVector::from_fn(COUNT, |k, _| {
            settings::BIAS_BY_DISTANCE[usize::from(!DISTANCES[0].contains(&(k.max(ALL) - ALL)))].powi(2)
        }));
        let scale = inverse_root(&apart * (&bias.spread * share + built_in) * apart.transpose());
        Self { weights, mean: scale * apart, clip: Some(inverse_root(bias.spread.clone())) }
    }

    /// Stacks one row per clip.
    #[must_use]
    pub fn of(&self, rows: &[DVector<f64>]) -> DVector<f64> {
        self.stacked(rows, rows)
    }

    /// The same, where the mean and the clips about it are those of other rows.
    #[must_use]
    pub fn stacked(&self, of_mean: &[DVector<f64>], of_clips: &[DVector<f64>]) -> DVector<f64> {
        let mean = |rows: &[DVector<f64>]| {
            rows.iter().zip(&self.weights).fold(DVector::zeros(COUNT), |sum, (row, weight)| sum + row * *weight)
        };
        let mut values: Vec<f64> = (&self.mean * mean(of_mean)).iter().copied().collect();
        if let Some(scale) = &self.clip {
            let middle = mean(of_clips);
            for (row, weight) in of_clips.iter().zip(&self.weights) {
                let about = scale * (row - &middle) * (weight * of_clips.len() as f64).sqrt();
                values.extend(about.iter());
            }
        }
        DVector::from_vec(values)
    }

    /// Stacks what every effect would do to each clip; one that a clip cannot show does nothing to it.
    #[must_use]
    pub fn paths(&self, clips: &[Vec<Path>]) -> Vec<Path> {
        let mut out: Vec<Path> = Vec::new();
        for path in clips.iter().flatten() {
            if out.iter().any(|known| known.same_way(path)) {
                continue;
            }
            let own: Vec<Option<&Path>> =
                clips.iter().map(|paths| paths.iter().find(|other| other.same_way(path))).collect();
            let change = (0..path.values.len()).map(|node| {
                let row = |path: &Option<&Path>| path.map_or_else(|| DVector::zeros(COUNT), |p| p.change[node].clone());
                self.of(&own.iter().map(row).collect::<Vec<_>>())
            });
            out.push(Path { values: path.values.clone(), change: change.collect(), ..*path });
        }
        out
    }
}

/// Returns the rows that take the nearest layer from each other one.
fn between_distances() -> DMatrix<f64> {
    let pairs: Vec<[usize; 2]> =
        DISTANCES.iter().flat_map(|layers| layers.clone().skip(1).map(|far| [ALL + layers.start, ALL + far])).collect();
    DMatrix::from_fn(pairs.len(), COUNT, |row, k| match pairs[row] {
        [near, _] if near == k => -1.0,
        [_, far] if far == k => 1.0,
        _ => 0.0,
    })
}

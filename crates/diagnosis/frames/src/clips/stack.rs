//! The clips of a case as one vector in units of their spread: their mean against the bias, where that is known, and each
//! clip against the mean of all. Constants show in the first part alone; what varies with the layout shows in both.

use nalgebra::{DMatrix, DVector};

use crate::clips::bias::Bias;
use crate::pairing::looks::ALL;
use crate::pairing::nuisance::inverse_root;
use crate::pairing::paths::Path;

/// Brings clips to units of their spread.
pub struct Stack {
    /// The scale of the mean, where the bias is known.
    mean: Option<DMatrix<f64>>,
    /// The scale of a clip about the mean.
    clip: DMatrix<f64>,
}

impl Stack {
    /// Prepares for so many clips.
    #[must_use]
    pub fn new(bias: &Bias, clips: usize) -> Self {
        let share = 1.0 / clips as f64 + 1.0 / bias.clips.max(1) as f64;
        let mean = bias.mean.as_ref().map(|_| inverse_root(&bias.spread * share));
        Self { mean, clip: inverse_root(bias.spread.clone()) }
    }

    /// Stacks one row per clip.
    #[must_use]
    pub fn of(&self, rows: &[DVector<f64>]) -> DVector<f64> {
        let mean = rows.iter().fold(DVector::zeros(ALL), |sum, row| sum + row) / rows.len() as f64;
        let known = self.mean.iter().map(|scale| scale * &mean);
        let parts = known.chain(rows.iter().map(|row| &self.clip * (row - &mean)));
        let values: Vec<f64> = parts.flat_map(|part| part.iter().copied().collect::<Vec<f64>>()).collect();
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
                let row = |path: &Option<&Path>| path.map_or_else(|| DVector::zeros(ALL), |p| p.change[node].clone());
                self.of(&own.iter().map(row).collect::<Vec<_>>())
            });
            out.push(Path { values: path.values.clone(), change: change.collect(), ..*path });
        }
        out
    }
}

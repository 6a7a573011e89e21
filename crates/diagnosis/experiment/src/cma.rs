//! A small evolution strategy with covariance adaptation (Hansen, The CMA Evolution Strategy: a tutorial, 2016): points of a
//! unit cube, best first, with a step that adapts to the length of its path.

use ds_space::Draws;
use nalgebra::{DMatrix, DVector};

/// Points of a generation.
pub(crate) const GENERATION: usize = 8;
/// Step at the start, as a share of the cube.
const STEP: f64 = 0.18;

/// A running search for the largest value.
pub(crate) struct Search {
    mean: DVector<f64>,
    step: f64,
    covariance: DMatrix<f64>,
    path_step: DVector<f64>,
    path_shape: DVector<f64>,
    weights: Vec<f64>,
    draws: Draws,
    drawn: u64,
}

impl Search {
    /// Begins at a point.
    #[must_use]
    pub(crate) fn new(start: &[f64], draws: Draws) -> Self {
        let (count, parents) = (start.len(), GENERATION / 2);
        let raw: Vec<f64> = (0..parents).map(|k| (parents as f64 + 0.5).ln() - (k as f64 + 1.0).ln()).collect();
        let sum: f64 = raw.iter().sum();
        Self {
            mean: DVector::from_row_slice(start),
            step: STEP,
            covariance: DMatrix::identity(count, count),
            path_step: DVector::zeros(count),
            path_shape: DVector::zeros(count),
            weights: raw.iter().map(|w| w / sum).collect(),
            draws,
            drawn: 0,
        }
    }

    /// Returns the points to try next, within the cube.
    pub(crate) fn ask(&mut self) -> Vec<Vec<f64>> {
        let root = self.root(f64::sqrt);
        let mut one = || {
            let normal = DVector::from_fn(self.mean.len(), |_, _| {
                self.drawn += 1;
                self.draws.normal(self.drawn)
            });
            let point = &self.mean + &root * normal * self.step;
            point.iter().map(|value| value.clamp(0.0, 1.0)).collect()
        };
        (0..GENERATION).map(|_| one()).collect()
    }

    /// Takes the points of a generation, best first.
    pub(crate) fn tell(&mut self, best_first: &[Vec<f64>]) {
        let count = self.mean.len() as f64;
        let effective = 1.0 / self.weights.iter().map(|w| w * w).sum::<f64>();
        let rate_step = (effective + 2.0) / (count + effective + 5.0);
        let damping = 1.0 + rate_step + 2.0 * (((effective - 1.0) / (count + 1.0)).sqrt() - 1.0).max(0.0);
        let rate_path = (4.0 + effective / count) / (count + 4.0 + 2.0 * effective / count);
        let rate_one = 2.0 / ((count + 1.3).powi(2) + effective);
        let rate_rank =
            (1.0 - rate_one).min(2.0 * (effective - 2.0 + 1.0 / effective) / ((count + 2.0).powi(2) + effective));
        let length = count.sqrt() * (1.0 - 0.25 / count + 1.0 / (21.0 * count * count));
        let steps: Vec<DVector<f64>> = best_first
            .iter()
            .take(self.weights.len())
            .map(|point| (DVector::from_row_slice(point) - &self.mean) / self.step)
            .collect();
        let mut moved = DVector::zeros(self.mean.len());
        steps.iter().zip(&self.weights).for_each(|(step, w)| moved += step * *w);
        let whitened = self.root(|value| 1.0 / value.sqrt()) * &moved;
        self.path_step =
            &self.path_step * (1.0 - rate_step) + whitened * (rate_step * (2.0 - rate_step) * effective).sqrt();
        self.path_shape =
            &self.path_shape * (1.0 - rate_path) + &moved * (rate_path * (2.0 - rate_path) * effective).sqrt();
        let mut spread = DMatrix::zeros(self.mean.len(), self.mean.len());
        steps.iter().zip(&self.weights).for_each(|(step, w)| spread += step * step.transpose() * *w);
        self.covariance = &self.covariance * (1.0 - rate_one - rate_rank)
            + &self.path_shape * self.path_shape.transpose() * rate_one
            + spread * rate_rank;
        self.mean += moved * self.step;
        self.step *= ((rate_step / damping) * (self.path_step.norm() / length - 1.0)).exp();
    }

    /// Returns a function of the covariance by its eigenvalues.
    fn root(&self, of: impl Fn(f64) -> f64) -> DMatrix<f64> {
        let eigen = self.covariance.clone().symmetric_eigen();
        let values = eigen.eigenvalues.map(|value| of(value.max(1e-14)));
        &eigen.eigenvectors * DMatrix::from_diagonal(&values) * eigen.eigenvectors.transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_narrow_hill_is_climbed_and_a_seed_repeats() {
        let height = |p: &[f64]| -> f64 {
            let [a, b, c] = [p[0] - 0.7, p[1] - 0.2, p[2] - 0.5];
            -((a + b).powi(2) * 40.0 + (a - b).powi(2) + c * c)
        };
        let climb = |seed: u64| {
            let mut search = Search::new(&[0.2, 0.8, 0.9], Draws::from_seed(seed, "hill"));
            for _ in 0..60 {
                let mut points = search.ask();
                points.sort_by(|a, b| height(b).total_cmp(&height(a)));
                search.tell(&points);
            }
            search.mean
        };
        for seed in 0..5 {
            let found = climb(seed);
            assert!(height(found.as_slice()) > -1e-4, "{found}");
        }
        assert_eq!(climb(3), climb(3));
    }
}

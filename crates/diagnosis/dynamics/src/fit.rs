//! Fits parameter vectors to residuals: Gauss-Newton with step halving on a Student-t loss with priors, and the
//! Laplace approximation of the evidence (MacKay 1992).
//!
//! loss(θ) = κ Σ (ν+1)/2 ln(1 + z²/ν) − ln prior(θ); evidence = −loss − ½ ln det(H / 2π). Residuals are in floor units.

use nalgebra::{DMatrix, DVector};

use crate::settings::{KAPPA, NU};

/// A model whose residuals, in floor units, depend on a vector; absent data have residual 0.
pub trait Model: Sync {
    /// Returns the residuals.
    fn residuals(&self, vector: &[f64]) -> Vec<f64>;
    /// Returns the step of the difference quotient for a coordinate.
    fn step(&self, coordinate: usize) -> f64;
}

/// What is believed of one coordinate before the data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Prior {
    /// It has this value.
    Fixed(f64),
    /// Normal, cut six standard deviations off the mean and at the ends of what makes sense.
    Normal {
        /// Mean.
        mean: f64,
        /// Standard deviation.
        sd: f64,
        /// Least and largest value that makes sense.
        within: (f64, f64),
    },
    /// Uniform.
    Slab {
        /// Lower end.
        low: f64,
        /// Upper end.
        high: f64,
    },
}

impl Prior {
    fn log_density(self, value: f64) -> f64 {
        match self {
            Self::Fixed(_) => 0.0,
            Self::Normal { mean, sd, .. } => {
                -0.5 * ((value - mean) / sd).powi(2) - (sd * std::f64::consts::TAU.sqrt()).ln()
            }
            Self::Slab { low, high } => -(high - low).max(1e-9).ln(),
        }
    }

    fn clip(self, value: f64) -> f64 {
        match self {
            Self::Fixed(fixed) => fixed,
            Self::Normal { mean, sd, within: (low, high) } => {
                value.clamp(mean - 6.0 * sd, mean + 6.0 * sd).clamp(low, high)
            }
            Self::Slab { low, high } => value.clamp(low, high),
        }
    }
}

/// Derivatives of the residuals by coordinate; columns are filled on demand and may be shared between fits.
pub type Columns = Vec<Option<std::sync::Arc<Vec<f64>>>>;

/// A fitted vector.
#[derive(Clone)]
pub struct Fit {
    /// The vector.
    pub vector: Vec<f64>,
    /// Its residuals.
    pub residuals: Vec<f64>,
    /// κ times the Student-t loss.
    pub data_loss: f64,
    /// Log evidence by Laplace.
    pub evidence: f64,
    /// Coordinates that were free.
    pub free: Vec<usize>,
    /// Posterior covariance over the free coordinates.
    pub covariance: DMatrix<f64>,
    /// Derivatives at or near the vector.
    pub columns: Columns,
}

/// Returns κ times the Student-t loss of residuals.
#[must_use]
pub fn data_loss(residuals: &[f64]) -> f64 {
    KAPPA * residuals.iter().map(|z| point_loss(*z)).sum::<f64>()
}

/// Returns the Student-t loss of one residual.
#[must_use]
pub fn point_loss(z: f64) -> f64 {
    0.5 * (NU + 1.0) * (1.0 + z * z / NU).ln()
}

/// How a fit is run.
#[derive(Clone)]
pub struct FitOptions<'a> {
    /// One per coordinate.
    pub priors: &'a [Prior],
    /// Start; fixed coordinates are set to their values.
    pub start: &'a [f64],
    /// Derivatives that may be reused where the coordinate is not in `fresh`.
    pub columns: Columns,
    /// Coordinates whose derivative is taken anew in every iteration.
    pub fresh: Vec<usize>,
    /// Iterations.
    pub iterations: usize,
}

/// Returns the derivative of the residuals by a coordinate, by a difference quotient.
pub fn column(model: &dyn Model, vector: &[f64], residuals: &[f64], k: usize, prior: Prior) -> Vec<f64> {
    let mut step = model.step(k);
    if let Prior::Slab { high, .. } = prior
        && vector[k] + step > high
    {
        step = -step;
    }
    let mut moved = vector.to_vec();
    moved[k] += step;
    let shifted = model.residuals(&moved);
    shifted.iter().zip(residuals).map(|(a, b)| (a - b) / step).collect()
}

/// Returns the log posterior of a start, up to a constant, with the sign of a loss.
pub fn start_loss(model: &dyn Model, priors: &[Prior], start: &[f64]) -> f64 {
    let vector: Vec<f64> = start.iter().zip(priors).map(|(v, p)| p.clip(*v)).collect();
    let prior: f64 = vector.iter().zip(priors).map(|(v, p)| p.log_density(*v)).sum();
    data_loss(&model.residuals(&vector)) - prior
}

/// Fits a model.
pub fn fit(model: &dyn Model, plan: FitOptions<'_>) -> Fit {
    let priors = plan.priors;
    let free: Vec<usize> = (0..priors.len()).filter(|&k| !matches!(priors[k], Prior::Fixed(_))).collect();
    let mut vector: Vec<f64> = plan.start.iter().zip(priors).map(|(v, p)| p.clip(*v)).collect();
    let mut residuals = model.residuals(&vector);
    let mut columns = plan.columns;
    let objective = |vector: &[f64], residuals: &[f64]| {
        data_loss(residuals) - free.iter().map(|&k| priors[k].log_density(vector[k])).sum::<f64>()
    };
    let mut best = objective(&vector, &residuals);
    for _ in 0..plan.iterations {
        for &k in &free {
            if columns[k].is_none() || plan.fresh.contains(&k) {
                columns[k] = Some(std::sync::Arc::new(column(model, &vector, &residuals, k, priors[k])));
            }
        }
        let (hessian, gradient) = normal_equations(&free, priors, &vector, &residuals, &columns);
        let Some(step) = inner_step(hessian, gradient, |i, step| {
            let k = free[i];
            priors[k].clip(vector[k]) == priors[k].clip(vector[k] - step) && step != 0.0
        }) else {
            break;
        };
        let mut scale = 1.0;
        let mut moved = false;
        for _ in 0..5 {
            let trial: Vec<f64> = (0..vector.len())
                .map(|k| {
                    free.iter().position(|f| *f == k).map_or(vector[k], |i| priors[k].clip(vector[k] - scale * step[i]))
                })
                .collect();
            let trial_residuals = model.residuals(&trial);
            let value = objective(&trial, &trial_residuals);
            if value < best {
                moved = best - value > 0.02;
                (vector, residuals, best) = (trial, trial_residuals, value);
                break;
            }
            scale *= 0.4;
        }
        if !moved {
            break;
        }
    }
    for &k in &free {
        if columns[k].is_none() {
            columns[k] = Some(std::sync::Arc::new(column(model, &vector, &residuals, k, priors[k])));
        }
    }
    finish(vector, residuals, free, priors, columns)
}

fn finish(vector: Vec<f64>, residuals: Vec<f64>, free: Vec<usize>, priors: &[Prior], columns: Columns) -> Fit {
    let (hessian, _) = normal_equations(&free, priors, &vector, &residuals, &columns);
    let loss = data_loss(&residuals);
    let prior: f64 = free.iter().map(|&k| priors[k].log_density(vector[k])).sum();
    let (log_det, covariance) = match hessian.clone().cholesky() {
        Some(factor) => (2.0 * factor.l().diagonal().iter().map(|d| d.ln()).sum::<f64>(), factor.inverse()),
        None => (f64::INFINITY, DMatrix::identity(free.len(), free.len())),
    };
    let evidence = -loss + prior - 0.5 * log_det + 0.5 * free.len() as f64 * std::f64::consts::TAU.ln();
    Fit { vector, residuals, data_loss: loss, evidence, free, covariance, columns }
}

/// Returns the Gauss-Newton Hessian and the gradient of the loss over the free coordinates.
fn normal_equations(
    free: &[usize],
    priors: &[Prior],
    vector: &[f64],
    residuals: &[f64],
    columns: &Columns,
) -> (DMatrix<f64>, DVector<f64>) {
    let count = free.len();
    let roots: Vec<f64> = residuals.iter().map(|z| (KAPPA * (NU + 1.0) / (NU + z * z)).sqrt()).collect();
    // one row per coordinate, so that the product runs as one blocked multiplication
    let mut rows = DMatrix::zeros(residuals.len(), count);
    for (i, &k) in free.iter().enumerate() {
        let Some(column) = &columns[k] else { continue };
        for ((r, c), weight) in rows.column_mut(i).iter_mut().zip(column.iter()).zip(&roots) {
            *r = c * weight;
        }
    }
    let pull = DVector::from_iterator(residuals.len(), residuals.iter().zip(&roots).map(|(z, w)| z * w));
    let mut gradient = rows.tr_mul(&pull);
    let mut hessian = rows.transpose() * &rows;
    for (i, &k) in free.iter().enumerate() {
        match priors[k] {
            Prior::Normal { mean, sd, .. } => {
                hessian[(i, i)] += 1.0 / (sd * sd);
                gradient[i] += (vector[k] - mean) / (sd * sd);
            }
            // a uniform prior has no curvature; a slab that the data leave open still has the width of the slab
            Prior::Slab { low, high } => hessian[(i, i)] += 12.0 / (high - low).max(1e-6).powi(2),
            Prior::Fixed(_) => {}
        }
    }
    (hessian, gradient)
}

/// Returns the step to subtract; coordinates that `held` tells to be at the end of their range with a step that leads
/// outwards stay where they are, and the others step without them.
fn inner_step(
    mut hessian: DMatrix<f64>,
    mut gradient: DVector<f64>,
    held: impl Fn(usize, f64) -> bool,
) -> Option<DVector<f64>> {
    loop {
        let step = hessian.clone().cholesky()?.solve(&gradient);
        let outward: Vec<usize> = (0..step.len()).filter(|&i| held(i, step[i])).collect();
        if outward.is_empty() {
            return Some(step);
        }
        for i in outward {
            hessian.row_mut(i).fill(0.0);
            hessian.column_mut(i).fill(0.0);
            hessian[(i, i)] = 1.0;
            gradient[i] = 0.0;
        }
    }
}

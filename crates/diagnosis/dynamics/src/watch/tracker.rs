//! What the log so far says of the ordinary mismatch, in one linear step a window: a Kalman filter of constant parameters.
//!
//! A window leaves residuals z = J d + e, d the distance from the usual values, d ~ N(0, S²) beforehand with the spread of
//! healthy logs. Its innovations are z - J d̂ over the root of 1 + diag(J P Jᵀ), by what was known before it; afterwards P⁻¹
//! grows by Jᵀ W J with the weights W of the diagnosis's loss, so that a residual that stands out moves little. What day and
//! load bring is learned in minutes; a fault that begins is not, because little of it is usual.

use nalgebra::{DMatrix, DVector};

use crate::settings::{KAPPA, NU};

/// What is known of the mismatch of a log.
#[derive(Debug, Clone)]
pub struct Tracker {
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl Tracker {
    /// Begins a log of a vehicle whose parameters have these spreads.
    #[must_use]
    pub fn new(spreads: &[f64]) -> Self {
        let variances = DVector::from_iterator(spreads.len(), spreads.iter().map(|sd| sd * sd));
        Self { mean: DVector::zeros(spreads.len()), covariance: DMatrix::from_diagonal(&variances) }
    }

    /// Takes the residuals of a window with their derivatives, a row for each; returns the innovations. A residual of nil
    /// was not measured.
    pub fn take(&mut self, residuals: &[f64], derivatives: &DMatrix<f64>) -> Vec<f64> {
        let expected = derivatives * &self.mean;
        let spread = derivatives * &self.covariance;
        let wide = |k: usize| (1.0 + spread.row(k).dot(&derivatives.row(k)).max(0.0)).sqrt();
        let rows = residuals.iter().enumerate();
        let innovations: Vec<f64> =
            rows.map(|(k, z)| if *z == 0.0 { 0.0 } else { (z - expected[k]) / wide(k) }).collect();
        let weight = |z: &f64| if *z == 0.0 { 0.0 } else { KAPPA * (NU + 1.0) / (NU + z * z) };
        let weights: Vec<f64> = innovations.iter().map(weight).collect();
        let mut weighted = derivatives.clone();
        weighted.row_iter_mut().zip(&weights).for_each(|(mut row, w)| row *= *w);
        let apart = DVector::from_iterator(residuals.len(), residuals.iter().zip(expected.iter()).map(|(z, e)| z - e));
        let Some(prior) = self.covariance.clone().cholesky() else { return innovations };
        if let Some(posterior) = (prior.inverse() + derivatives.tr_mul(&weighted)).cholesky() {
            self.mean += posterior.solve(&weighted.tr_mul(&apart));
            self.covariance = posterior.inverse();
        }
        innovations
    }
}

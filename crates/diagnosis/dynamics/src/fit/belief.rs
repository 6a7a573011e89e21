//! What is believed of the free coordinates before the data: each by itself, or those with a usual spread together.

use nalgebra::{DMatrix, DVector};

use super::{Fit, Prior};

/// The prior of the free coordinates.
pub(crate) struct Belief<'a> {
    priors: &'a [Prior],
    /// Coordinates that are free.
    pub(super) free: Vec<usize>,
    joint: Option<Joint>,
}

/// How far a fitted coordinate lies off what is usual, given the others.
pub(crate) struct Offset {
    /// Value.
    pub(crate) value: f64,
    /// Its variance, the prior's part included.
    pub(crate) variance: f64,
    /// Standard deviation before the data.
    pub(crate) sd: f64,
}

/// The coordinates with a usual spread, as one normal distribution.
struct Joint {
    /// Places among the free coordinates.
    at: Vec<usize>,
    means: DVector<f64>,
    precision: DMatrix<f64>,
    /// Logarithm of the density at the means.
    at_means: f64,
}

impl<'a> Belief<'a> {
    /// Takes priors, and how the first coordinates go together where they do.
    pub(crate) fn new(priors: &'a [Prior], correlation: Option<&DMatrix<f64>>) -> Self {
        let free: Vec<usize> = (0..priors.len()).filter(|&k| !matches!(priors[k], Prior::Fixed(_))).collect();
        let joint = correlation.and_then(|r| Joint::new(priors, &free, r));
        Self { priors, free, joint }
    }

    /// Returns the logarithm of the density.
    pub(super) fn log_density(&self, vector: &[f64]) -> f64 {
        let own = |k: &usize| self.priors[*k].log_density(vector[*k]);
        let Some(joint) = &self.joint else { return self.free.iter().map(own).sum() };
        let apart: f64 = self.free.iter().filter(|k| !matches!(self.priors[**k], Prior::Normal { .. })).map(own).sum();
        let off = joint.off(&self.free, vector);
        apart + joint.at_means - 0.5 * off.dot(&(&joint.precision * &off))
    }

    /// Returns how far a coordinate of a fit under this prior lies off; `None` where it has no usual spread or was not free.
    pub(crate) fn offset(&self, fit: &Fit, k: usize) -> Option<Offset> {
        let i = fit.free.iter().position(|free| *free == k)?;
        let Prior::Normal { mean, sd, .. } = self.priors[k] else { return None };
        let Some(joint) = &self.joint else {
            return Some(Offset { value: fit.vector[k] - mean, variance: fit.covariance[(i, i)], sd });
        };
        let own = joint.at.iter().position(|at| *at == i)?;
        let conditional = joint.precision.column(own) / joint.precision[(own, own)];
        let within =
            DMatrix::from_fn(joint.at.len(), joint.at.len(), |a, b| fit.covariance[(joint.at[a], joint.at[b])]);
        Some(Offset {
            value: conditional.dot(&joint.off(&self.free, &fit.vector)),
            variance: conditional.dot(&(within * &conditional)),
            sd: joint.precision[(own, own)].powf(-0.5),
        })
    }

    /// Adds what it contributes to the Hessian and the gradient of a loss over the free coordinates.
    pub(super) fn add(&self, vector: &[f64], hessian: &mut DMatrix<f64>, gradient: &mut DVector<f64>) {
        for (i, &k) in self.free.iter().enumerate() {
            match self.priors[k] {
                Prior::Normal { mean, sd, .. } if self.joint.is_none() => {
                    hessian[(i, i)] += 1.0 / (sd * sd);
                    gradient[i] += (vector[k] - mean) / (sd * sd);
                }
                // a uniform prior has no curvature; a slab that the data leave open still has the width of the slab
                Prior::Slab { low, high } => hessian[(i, i)] += 12.0 / (high - low).max(1e-6).powi(2),
                Prior::Normal { .. } | Prior::Fixed(_) => {}
            }
        }
        if let Some(joint) = &self.joint {
            let pull = &joint.precision * joint.off(&self.free, vector);
            for (a, &i) in joint.at.iter().enumerate() {
                gradient[i] += pull[a];
                joint.at.iter().enumerate().for_each(|(b, &j)| hessian[(i, j)] += joint.precision[(a, b)]);
            }
        }
    }
}

impl Joint {
    fn new(priors: &[Prior], free: &[usize], correlation: &DMatrix<f64>) -> Option<Self> {
        let normal = |i: usize| match priors[free[i]] {
            Prior::Normal { mean, sd, .. } => Some((i, mean, sd)),
            Prior::Fixed(_) | Prior::Slab { .. } => None,
        };
        let all: Vec<(usize, f64, f64)> = (0..free.len()).filter_map(normal).collect();
        let between = |a: usize, b: usize| {
            let (i, j) = (free[all[a].0], free[all[b].0]);
            let known = i.max(j) < correlation.nrows();
            all[a].2 * all[b].2 * if known { correlation[(i, j)] } else { f64::from(u8::from(i == j)) }
        };
        let covariance = DMatrix::from_fn(all.len(), all.len(), between).cholesky()?;
        let half_log_det: f64 = covariance.l_dirty().diagonal().iter().map(|d| d.ln()).sum();
        Some(Self {
            at: all.iter().map(|a| a.0).collect(),
            means: DVector::from_iterator(all.len(), all.iter().map(|a| a.1)),
            precision: covariance.inverse(),
            at_means: -half_log_det - 0.5 * all.len() as f64 * std::f64::consts::TAU.ln(),
        })
    }

    fn off(&self, free: &[usize], vector: &[f64]) -> DVector<f64> {
        DVector::from_iterator(self.at.len(), self.at.iter().zip(&self.means).map(|(i, mean)| vector[free[*i]] - mean))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PRIORS: [Prior; 4] = [
        Prior::Normal { mean: 1.0, sd: 2.0, within: (-9.0, 9.0) },
        Prior::Fixed(3.0),
        Prior::Slab { low: 0.0, high: 4.0 },
        Prior::Normal { mean: -1.0, sd: 0.5, within: (-9.0, 9.0) },
    ];

    #[test]
    fn coordinates_that_do_not_go_together_are_believed_each_by_itself() {
        let (apart, together) = (Belief::new(&PRIORS, None), Belief::new(&PRIORS, Some(&DMatrix::identity(4, 4))));
        let vector = [2.5, 3.0, 1.0, -1.4];
        assert!((apart.log_density(&vector) - together.log_density(&vector)).abs() < 1e-12);
        let of = |belief: &Belief<'_>| {
            let (mut hessian, mut gradient) = (DMatrix::zeros(3, 3), DVector::zeros(3));
            belief.add(&vector, &mut hessian, &mut gradient);
            (hessian, gradient)
        };
        let ((h, g), (h2, g2)) = (of(&apart), of(&together));
        assert!((h - h2).abs().max() < 1e-12 && (g - g2).abs().max() < 1e-12);
    }

    #[test]
    fn what_goes_together_is_likelier_together_and_the_gradient_is_that_of_the_density() {
        let mut r = DMatrix::identity(4, 4);
        (r[(0, 3)], r[(3, 0)]) = (0.8, 0.8);
        let belief = Belief::new(&PRIORS, Some(&r));
        assert!(belief.log_density(&[3.0, 3.0, 1.0, -0.5]) > belief.log_density(&[3.0, 3.0, 1.0, -1.5]) + 1.0);
        let vector = [2.5, 3.0, 1.0, -1.4];
        let (mut hessian, mut gradient) = (DMatrix::zeros(3, 3), DVector::zeros(3));
        belief.add(&vector, &mut hessian, &mut gradient);
        for (i, k) in [(0, 0), (2, 3)] {
            let mut moved = vector;
            moved[k] += 1e-5;
            let slope = (belief.log_density(&vector) - belief.log_density(&moved)) / 1e-5;
            assert!((slope - gradient[i]).abs() < 1e-3, "{slope} {}", gradient[i]);
        }
    }
}

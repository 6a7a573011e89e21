//! How the usual values of parameters go together from log to log: of a delay and a lag of one actuator a log often tells the
//! sum alone, and it is the sum that stays the same.
//!
//! θᵢ ~ N(μ, S) with what each log says of all its parameters at once (its likelihood's precision Λᵢ, not only the diagonal);
//! the spreads are those found parameter by parameter, the correlation is found by expectation and maximisation under an
//! inverse Wishart prior that expects none.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::Usual;
use super::study::Information;
use crate::space::Space;

/// Logs as which the expectation of no correlation counts.
const FREEDOM: f64 = 4.0;
/// Steps of expectation and maximisation.
const STEPS: usize = 30;
/// A parameter with less correlation than this to any other goes by itself.
const LEAST: f64 = 0.05;

/// Correlations of usual values.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Covariation {
    /// The parameters: effect, and which of its parameters.
    pub of: Vec<(String, usize)>,
    /// Correlations of these, below the diagonal, row by row.
    pub below: Vec<f64>,
}

impl Covariation {
    /// Learns from what each log says, where usual values are known.
    pub(crate) fn learn(space: &Space, usual: &[Option<Usual>], logs: &[&Information]) -> Self {
        let open: Vec<usize> = (0..usual.len()).filter(|&k| usual[k].is_some()).collect();
        let scale = |k: usize| usual[open[k]].map_or((0.0, 1.0), |u| (u.mean, u.sd));
        let each: Vec<(DMatrix<f64>, DVector<f64>)> = logs.iter().map(|log| log.about(&open, &scale)).collect();
        let mut r = DMatrix::identity(open.len(), open.len());
        for _ in 0..STEPS {
            let Some(inverse) = r.clone().cholesky().map(|c| c.inverse()) else { return Self::default() };
            let mut sum: DMatrix<f64> = DMatrix::identity(open.len(), open.len()) * FREEDOM;
            for (precision, pull) in &each {
                let Some(posterior) = (precision + &inverse).cholesky() else { return Self::default() };
                let mean = posterior.solve(pull);
                sum += posterior.inverse() + &mean * mean.transpose();
            }
            let roots: Vec<f64> = sum.diagonal().iter().map(|d| d.sqrt()).collect();
            r = DMatrix::from_fn(open.len(), open.len(), |i, j| sum[(i, j)] / (roots[i] * roots[j]));
        }
        let related = |i: &usize| (0..open.len()).any(|j| j != *i && r[(*i, j)].abs() >= LEAST);
        let kept: Vec<usize> = (0..open.len()).filter(related).collect();
        let named = |i: &usize| {
            let effect = space.coordinates[open[*i]].effect;
            (space.effects[effect].id.to_owned(), open[*i] - space.of(effect)[0])
        };
        let round = |value: f64| (1e6 * value).round() / 1e6;
        let below = kept.iter().enumerate().flat_map(|(a, &i)| kept[..a].iter().map(move |&j| (i, j)));
        Self { of: kept.iter().map(named).collect(), below: below.map(|pair| round(r[pair])).collect() }
    }

    /// Tells whether the table has the size that it must have, and is one of correlations.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        let count = self.of.len();
        self.below.len() == count * count.saturating_sub(1) / 2
            && self.below.iter().all(|r| r.abs() < 1.0)
            && self.matrix().cholesky().is_some()
    }

    fn matrix(&self) -> DMatrix<f64> {
        DMatrix::from_fn(self.of.len(), self.of.len(), |i, j| self.between(i, j))
    }

    fn between(&self, i: usize, j: usize) -> f64 {
        let (high, low) = (i.max(j), i.min(j));
        if high == low { 1.0 } else { self.below[high * (high - 1) / 2 + low] }
    }

    /// Returns the correlations of all coordinates of a space; nothing where none go together.
    pub(crate) fn over(&self, space: &Space) -> Option<DMatrix<f64>> {
        let place = |(id, place): &(String, usize)| Some(*space.of(space.find(id)?).get(*place)?);
        let known: Vec<(usize, usize)> =
            self.of.iter().enumerate().filter_map(|(i, of)| Some((i, place(of)?))).collect();
        let count = space.coordinates.len();
        let mut out = DMatrix::identity(count, count);
        for (i, a) in &known {
            known.iter().for_each(|(j, b)| out[(*a, *b)] = self.between(*i, *j));
        }
        (known.len() > 1).then_some(out)
    }
}

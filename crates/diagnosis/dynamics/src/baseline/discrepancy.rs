//! What the nominal simulator gets wrong on healthy drives and no parameter mends, as a function of state and commands: one
//! ridge regression a channel of the residuals that the fitted mismatch leaves, in floor units.
//!
//! The strength of the ridge is that which predicts a healthy log from the others best; where none does, there is no
//! discrepancy. Far from the states that were seen the prediction is as uncertain as its leverage says.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::features::FEATURES;
use super::study::Study;
use crate::fit::point_loss;
use crate::windows::EGO;

/// Strengths tried, weakest first.
const RIDGES: [f64; 5] = [30.0, 100.0, 300.0, 1000.0, 3000.0];
/// Share of the loss that a regression must save on logs left out.
const WORTH: f64 = 0.01;
/// Rows that tell the same: windows overlap and blocks share their noise.
const SHARED: f64 = 4.0;
/// Largest coefficient: residuals are cut, and the ridge holds what they ask for.
const LARGEST: f64 = 1e5;
/// Residuals beyond this are cut: a slide is no trait.
pub(crate) const CUT: f64 = 6.0;

/// The predicted residuals of healthy drives.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Discrepancy {
    /// Coefficients by channel, in the order of the channels; empty where nothing is predicted.
    pub coefficients: Vec<Vec<f64>>,
    /// Inverse of the ridge's normal matrix, row by row: how uncertain a prediction is.
    pub inverse: Vec<f64>,
}

/// Sums over the rows of some logs.
struct Sums {
    gram: DMatrix<f64>,
    pulls: Vec<DVector<f64>>,
}

impl Sums {
    fn of(studies: &[&Study]) -> Self {
        let mut sums = Self { gram: DMatrix::zeros(FEATURES, FEATURES), pulls: vec![DVector::zeros(FEATURES); EGO] };
        for study in studies {
            for features in &study.features {
                let f = DVector::from_column_slice(features);
                sums.gram.ger(1.0, &f, &f, 1.0);
            }
            for row in &study.rows {
                let f = DVector::from_column_slice(&study.features[row.place]);
                sums.pulls[row.channel].axpy(row.residual.clamp(-CUT, CUT), &f, 1.0);
            }
        }
        sums
    }

    fn solve(&self, ridge: f64) -> Option<(Vec<Vec<f64>>, DMatrix<f64>)> {
        let factor = (&self.gram + DMatrix::identity(FEATURES, FEATURES) * ridge).cholesky()?;
        let of = |pull: &DVector<f64>| factor.solve(pull).as_slice().to_vec();
        Some((self.pulls.iter().map(of).collect(), factor.inverse()))
    }
}

impl Discrepancy {
    /// Learns from the residuals of healthy logs.
    #[must_use]
    pub fn learn(studies: &[&Study]) -> Self {
        if studies.len() < 2 {
            return Self::default();
        }
        let without: Vec<Sums> = (0..studies.len())
            .map(|out| {
                let others: Vec<&Study> =
                    studies.iter().enumerate().filter(|(k, _)| *k != out).map(|(_, s)| *s).collect();
                Sums::of(&others)
            })
            .collect();
        let nothing: Vec<f64> = losses(studies, |_| None);
        let all = Sums::of(studies);
        let mut best: Vec<(f64, Option<f64>)> = nothing.iter().map(|loss| ((1.0 - WORTH) * loss, None)).collect();
        for ridge in RIDGES {
            let solved: Vec<_> = without.iter().map(|sums| sums.solve(ridge).map(|s| s.0)).collect();
            let found = losses(studies, |out| solved[out].as_ref());
            for (best, loss) in best.iter_mut().zip(found) {
                if loss < best.0 {
                    *best = (loss, Some(ridge));
                }
            }
        }
        let strongest = best.iter().filter_map(|b| b.1).fold(0.0, f64::max);
        let mut out = Self { coefficients: vec![Vec::new(); EGO], inverse: Vec::new() };
        for (channel, (_, ridge)) in best.iter().enumerate() {
            let Some((coefficients, _)) = ridge.and_then(|ridge| all.solve(ridge)) else { continue };
            out.coefficients[channel].clone_from(&coefficients[channel]);
        }
        if let Some((_, inverse)) = (strongest > 0.0).then(|| all.solve(strongest)).flatten() {
            out.inverse = inverse.as_slice().to_vec();
        }
        out
    }

    /// Says which table is missing or wrong and why, if any is.
    #[must_use]
    pub(crate) fn unsound(&self) -> Option<String> {
        let channels = self.coefficients.len();
        if channels != 0 && channels != EGO {
            return Some(format!("coefficients has {channels} channels, not {EGO}"));
        }
        let odd = self.coefficients.iter().map(Vec::len).find(|own| *own != 0 && *own != FEATURES);
        if let Some(own) = odd {
            return Some(format!("coefficients has a channel of {own} numbers, not {FEATURES}"));
        }
        if !self.coefficients.iter().flatten().all(|c| c.abs() < LARGEST) {
            return Some("coefficients holds what no residuals ask for".to_owned());
        }
        let asked = if self.coefficients.iter().all(Vec::is_empty) { 0 } else { FEATURES * FEATURES };
        let own = self.inverse.len();
        if own != asked {
            return Some(format!("inverse has {own} numbers, not {asked}, as goes with its coefficients"));
        }
        (!self.inverts()).then(|| "inverse is that of no ridge".to_owned())
    }

    /// Tells whether the inverse can be one of a sum of squares on a ridge: symmetric, its diagonal positive and no larger than the
    /// weakest ridge's, nothing beside it larger than that allows.
    fn inverts(&self) -> bool {
        let at = |i: usize, j: usize| self.inverse[i * FEATURES + j];
        let largest = (1.0 + 1e-6) / RIDGES[0];
        let within = |i: usize, j: usize| {
            let scale = (at(i, i) * at(j, j)).sqrt();
            (at(i, j) - at(j, i)).abs() <= 1e-6 * scale && at(i, j).abs() <= (1.0 + 1e-6) * scale
        };
        let rows = self.inverse.len() / FEATURES;
        (0..rows).all(|i| at(i, i) > 0.0 && at(i, i) <= largest && (0..i).all(|j| within(i, j)))
    }

    /// Returns the predicted residual of a channel, in floor units of the library.
    #[must_use]
    pub fn at(&self, channel: usize, features: &[f64; FEATURES]) -> f64 {
        let Some(coefficients) = self.coefficients.get(channel) else { return 0.0 };
        coefficients.iter().zip(features).map(|(c, f)| c * f).sum::<f64>().clamp(-CUT, CUT)
    }

    /// Returns the factor by which a residual is more uncertain than among the states that were seen.
    #[must_use]
    pub fn widening(&self, features: &[f64; FEATURES]) -> f64 {
        if self.inverse.len() != FEATURES * FEATURES {
            return 1.0;
        }
        let inverse = DMatrix::from_column_slice(FEATURES, FEATURES, &self.inverse);
        let f = DVector::from_column_slice(features);
        (1.0 + SHARED * f.dot(&(inverse * &f)).max(0.0)).sqrt().min(5.0)
    }
}

/// Returns the mean loss by channel of every log, each predicted by the coefficients given for it.
fn losses<'a>(studies: &[&Study], of: impl Fn(usize) -> Option<&'a Vec<Vec<f64>>>) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0); EGO];
    for (out, study) in studies.iter().enumerate() {
        let coefficients = of(out);
        for row in &study.rows {
            let predicted = coefficients.map_or(0.0, |c| {
                c[row.channel].iter().zip(&study.features[row.place]).map(|(c, f)| c * f).sum::<f64>().clamp(-CUT, CUT)
            });
            sums[row.channel].0 += point_loss(row.residual - predicted);
            sums[row.channel].1 += 1.0;
        }
    }
    sums.into_iter().map(|(sum, count)| if count > 0.0 { sum / count } else { 0.0 }).collect()
}

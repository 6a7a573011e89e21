//! A law fitted to the simulator itself, together with the nuisances; its delays, widths and thresholds by trial.

use ds_dynamics::fit::{Fit, FitOptions, Prior, fit};
use ds_effect::law::Term;
use ds_effect::{Law, Port};
use nalgebra::DMatrix;

use crate::port::{Base, WithLaw, sizes, term};
use crate::terms::{Candidate, rounded};

/// Factors tried on inner numbers, round by round.
const STRETCHES: [[f64; 2]; 5] = [[0.6, 1.6], [0.8, 1.25], [0.9, 1.1], [0.95, 1.05], [0.97, 1.03]];
/// Largest coefficient, in units of the usual size.
const LARGEST: f64 = 8.0;
/// Steps of a fit.
const STEPS: usize = 4;

/// A fitted law.
#[derive(Clone)]
pub(crate) struct Refined {
    /// Where it acts.
    pub(crate) port: Port,
    /// Its terms.
    pub(crate) terms: Vec<Candidate>,
    /// How the coefficients, in units of the usual sizes, go together beforehand: by rows what independent normal numbers make of them.
    pub(crate) mixing: DMatrix<f64>,
    /// Nuisances, then those numbers.
    pub(crate) fit: Fit,
    /// Log evidence over the nuisance fit, less what the linear search takes for the choice of the set.
    pub(crate) gain: f64,
}

impl Refined {
    /// Fits a law whose terms are independent beforehand from a start.
    pub(crate) fn new(base: &Base<'_, '_>, port: Port, terms: Vec<Candidate>, start: &[f64], cost: f64) -> Self {
        let mixing = DMatrix::identity(terms.len(), terms.len());
        Self::mixed(base, port, (terms, mixing), start, cost)
    }

    /// Fits a law whose terms go together in some way beforehand from a start.
    pub(crate) fn mixed(
        base: &Base<'_, '_>,
        port: Port,
        (terms, mixing): (Vec<Candidate>, DMatrix<f64>),
        start: &[f64],
        cost: f64,
    ) -> Self {
        let own = base.model.space.coordinates.len();
        let mut vector = base.null.vector.clone();
        vector.extend_from_slice(start);
        let mut priors = base.model.null_priors();
        priors.resize(own + terms.len(), Prior::Normal { mean: 0.0, sd: 1.0, within: (-LARGEST, LARGEST) });
        let mut columns = base.null.columns.clone();
        columns.resize(own + terms.len(), None);
        let model = WithLaw { model: base.model, port, terms: &terms, mixing: &mixing };
        let fresh = (own..own + terms.len()).collect();
        let found = fit(&model, FitOptions { priors: &priors, start: &vector, columns, fresh, iterations: STEPS });
        let gain = found.evidence - base.null.evidence + cost;
        Self { port, terms, mixing, fit: found, gain }
    }

    /// Returns the coefficients in units of the usual sizes.
    pub(crate) fn sizes(&self) -> Vec<f64> {
        sizes(&self.mixing, &self.fit.vector)
    }

    /// Returns the nuisances.
    pub(crate) fn nuisances(&self) -> &[f64] {
        &self.fit.vector[..self.fit.vector.len() - self.terms.len()]
    }

    /// Returns the standard errors of the coefficients, in units of the usual sizes.
    pub(crate) fn errors(&self) -> Vec<f64> {
        let own = self.fit.vector.len() - self.terms.len();
        let place = |k: usize| self.fit.free.iter().position(|free| *free == own + k);
        let places: Vec<Option<usize>> = (0..self.terms.len()).map(place).collect();
        let known = |i: usize, j: usize| places[i].zip(places[j]).map_or(0.0, |at| self.fit.covariance[at]);
        let spread = DMatrix::from_fn(places.len(), places.len(), known);
        (&self.mixing * spread * self.mixing.transpose()).diagonal().iter().map(|v| v.max(0.0).sqrt()).collect()
    }

    /// Returns the law.
    pub(crate) fn law(&self) -> Option<Law> {
        let written = |(t, size): (&Candidate, &f64)| Term { coefficient: rounded(t.scale * size), ..term(t, *size) };
        let terms = self.terms.iter().zip(&self.sizes()).map(written).collect();
        Law::new(self.port, terms).ok()
    }

    /// Improves the inner numbers of the terms, one after another.
    pub(crate) fn stretched(self, base: &Base<'_, '_>, cost: f64) -> Self {
        let mut best = self;
        for factors in STRETCHES {
            for place in 0..best.terms.len() {
                for factor in factors {
                    let Some(term) = base.signals.stretched(best.port, &best.terms[place], factor) else { continue };
                    let mut terms = best.terms.clone();
                    let mut start = best.sizes();
                    start[place] *= best.terms[place].scale / term.scale;
                    terms[place] = term;
                    let tried = Self::new(base, best.port, terms, &start, cost);
                    if tried.gain > best.gain {
                        best = tried;
                    }
                }
            }
        }
        best
    }
}

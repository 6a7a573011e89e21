//! One part of the loop: the nuisance fit, and at each port the laws of the linear search.

use std::ops::Range;
use std::sync::Arc;

use ds_dynamics::case::PartModel;
use ds_dynamics::fit::{Fit, Model};
use ds_dynamics::search::null_fit;
use ds_effect::law::Term;
use ds_effect::{Law, Port};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::linear::{Fitted, Rows, Spring};
use crate::spectrum;
use crate::terms::{Candidate, Signals};

/// Share of the usual size of a law at which the difference quotient is taken.
pub(crate) const STEP: f64 = 0.1;

/// The nuisance fit of a part, as a base for columns.
pub(crate) struct Base<'m, 'c> {
    /// The part's model.
    pub(crate) model: &'m PartModel<'c>,
    /// Its nuisance fit.
    pub(crate) null: Fit,
    /// Sizes and domains of what laws may read.
    pub(crate) signals: Signals<'m, 'c>,
    /// Frequencies of lines in what the nuisances leave.
    pub(crate) lines_hz: Vec<f64>,
}

/// A port with the laws that explain most there.
pub(crate) struct Searched<'b> {
    /// The port.
    pub(crate) port: Port,
    /// Its terms.
    pub(crate) candidates: Vec<Candidate>,
    /// Their columns beside the nuisances'.
    pub(crate) rows: Rows<'b>,
    /// The fit without any term.
    pub(crate) empty: Fitted,
    /// Fitted sets, best first.
    pub(crate) sets: Vec<Fitted>,
}

impl<'m, 'c> Base<'m, 'c> {
    /// Fits the nuisances.
    pub(crate) fn new(model: &'m PartModel<'c>) -> Self {
        let null = null_fit(model, None);
        let signals = Signals::new(model, &null.vector);
        let lines_hz = spectrum::lines_hz(model, &null.residuals);
        Self { model, null, signals, lines_hz }
    }

    /// Searches a port; `None` where nothing there could be seen.
    pub(crate) fn search(&self, port: Port) -> Option<Searched<'_>> {
        let mut candidates = self.signals.candidates(port, &self.lines_hz);
        let mut columns: Vec<Vec<f64>> = candidates.par_iter().map(|c| self.column(port, c)).collect();
        let seen: Vec<bool> = columns.iter().map(|column| column.iter().any(|v| *v != 0.0)).collect();
        let mut keep = seen.iter();
        candidates.retain(|_| keep.next() == Some(&true));
        let mut keep = seen.iter();
        columns.retain(|_| keep.next() == Some(&true));
        if candidates.is_empty() {
            return None;
        }
        let rows = Rows {
            residuals: &self.null.residuals,
            drives: drives(self.model),
            nuisances: self.nuisances().into_iter().map(|(_, column)| column.as_slice()).collect(),
            springs: self.nuisances().into_iter().map(|(k, _)| self.spring(k)).collect(),
            terms: columns,
            groups: candidates.iter().map(|c| c.group.clone()).collect(),
        };
        let empty = rows.settle(&[], &self.null.residuals, None);
        let sets = rows.search(&empty);
        (!sets.is_empty()).then_some(Searched { port, candidates, rows, empty, sets })
    }

    fn nuisances(&self) -> Vec<(usize, &Arc<Vec<f64>>)> {
        let known = |&k: &usize| self.null.columns[k].as_ref().map(|column| (k, column));
        self.null.free.iter().filter_map(known).collect()
    }

    fn spring(&self, k: usize) -> Spring {
        let usual = self.model.space.coordinates[k].nuisance;
        let (mean, sd) = usual.map_or((self.null.vector[k], 1e6), |n| (n.mean, n.sd));
        Spring { offset: self.null.vector[k] - mean, sd }
    }

    /// Returns how the residuals change with a term's coefficient, in units of its usual size.
    pub(crate) fn column(&self, port: Port, candidate: &Candidate) -> Vec<f64> {
        Law::new(port, vec![term(candidate, STEP)]).map_or_else(|_| Vec::new(), |law| self.change(&law))
    }

    /// Returns how the residuals change with a law that is [`STEP`] of something, per that.
    pub(crate) fn change(&self, law: &Law) -> Vec<f64> {
        let moved = self.model.residuals_under(&self.null.vector, std::slice::from_ref(law));
        let change = |(a, b): (f64, &f64)| if *b == 0.0 || a.abs() >= 1e6 { 0.0 } else { (a - b) / STEP };
        moved.into_iter().zip(&self.null.residuals).map(change).collect()
    }
}

impl Searched<'_> {
    /// Returns a set of terms as a law, with the terms in units of their usual size.
    pub(crate) fn law(&self, fitted: &Fitted) -> (Vec<Candidate>, Vec<f64>) {
        let n = self.rows.nuisances.len();
        let terms = fitted.set.iter().map(|&k| self.candidates[k].clone()).collect();
        (terms, (0..fitted.set.len()).map(|place| fitted.moves[n + place]).collect())
    }
}

/// Returns a term of some size in units of its usual one.
pub(crate) fn term(candidate: &Candidate, size: f64) -> Term {
    Term { coefficient: size * candidate.scale, expression: candidate.expression.clone() }
}

/// Returns the rows of each drive.
fn drives(model: &PartModel<'_>) -> Vec<Range<usize>> {
    let mut out: Vec<(usize, Range<usize>)> = Vec::new();
    for (row, tag) in model.tags.iter().enumerate() {
        match out.last_mut() {
            Some((drive, rows)) if *drive == tag.drive => rows.end = row + 1,
            _ => out.push((tag.drive, row..row + 1)),
        }
    }
    out.into_iter().map(|(_, rows)| rows).collect()
}

/// The model of a part with a law added, its coefficients behind the nuisances.
pub(crate) struct WithLaw<'a, 'c> {
    /// The part.
    pub(crate) model: &'a PartModel<'c>,
    /// Where the law acts.
    pub(crate) port: Port,
    /// Its terms.
    pub(crate) terms: &'a [Candidate],
    /// What their coefficients are of the numbers of a vector.
    pub(crate) mixing: &'a DMatrix<f64>,
}

/// Returns the coefficients of a law at the end of a vector, in units of the usual sizes.
pub(crate) fn sizes(mixing: &DMatrix<f64>, vector: &[f64]) -> Vec<f64> {
    let own = DVector::from_column_slice(&vector[vector.len() - mixing.ncols()..]);
    (mixing * own).as_slice().to_vec()
}

impl WithLaw<'_, '_> {
    /// Returns the law of a vector; `None` where all coefficients are nil.
    pub(crate) fn law(&self, vector: &[f64]) -> Option<Law> {
        let sizes = sizes(self.mixing, vector);
        Law::new(self.port, self.terms.iter().zip(sizes).map(|(t, size)| term(t, size)).collect()).ok()
    }
}

impl Model for WithLaw<'_, '_> {
    fn residuals(&self, vector: &[f64]) -> Vec<f64> {
        let own = vector.len() - self.terms.len();
        let laws: Vec<Law> = self.law(vector).into_iter().collect();
        self.model.residuals_under(&vector[..own], &laws)
    }

    fn step(&self, coordinate: usize) -> f64 {
        if coordinate < self.model.space.coordinates.len() { self.model.space.step(coordinate) } else { STEP }
    }
}

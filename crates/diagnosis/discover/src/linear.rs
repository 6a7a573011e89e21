//! Laws of one port as columns beside those of the nuisances: residuals change in proportion to the coefficients, so that
//! one Gram matrix per drive tells the evidence of every set of terms, and leaving a drive out is a subtraction.
//!
//! gain(S) = ½ sᵀ(M + 1)⁻¹s − ½ ln|M + 1| with s and M the projections after the nuisances are eliminated (Schur complement)
//! and coefficients in units of their prior. The Student-t loss is met by weights of rows that follow the best set.

use std::ops::Range;

use ds_dynamics::fit::data_loss;
use ds_dynamics::settings::{KAPPA, NU};
use nalgebra::{DMatrix, DVector};

/// Most terms of a law.
pub(crate) const MOST_TERMS: usize = 3;
/// Passes of weights and enumeration.
const PASSES: usize = 3;
/// Steps of weighted least squares for one set.
const STEPS: usize = 6;
/// Sets that are fitted after the enumeration.
const KEPT_SETS: usize = 6;
/// Log prior of the number of terms, none included.
const LOG_PRIOR: [f64; 4] = [-0.693, -1.05, -2.12, -3.51];

/// A normal prior of a nuisance at the base point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Spring {
    /// Base point less prior mean.
    pub(crate) offset: f64,
    /// Prior standard deviation.
    pub(crate) sd: f64,
}

/// The residuals at a base point and how they change.
pub(crate) struct Rows<'a> {
    /// In floor units.
    pub(crate) residuals: &'a [f64],
    /// Rows of each drive.
    pub(crate) drives: Vec<Range<usize>>,
    /// Derivatives by nuisances.
    pub(crate) nuisances: Vec<&'a [f64]>,
    /// Their priors.
    pub(crate) springs: Vec<Spring>,
    /// Derivatives by coefficients, in units of their prior.
    pub(crate) terms: Vec<Vec<f64>>,
    /// Terms of one group exclude each other.
    pub(crate) groups: Vec<String>,
}

/// A set of terms, fitted.
#[derive(Debug, Clone)]
pub(crate) struct Fitted {
    /// Places of its terms.
    pub(crate) set: Vec<usize>,
    /// Moves of the nuisances, then coefficients in units of their prior.
    pub(crate) moves: DVector<f64>,
    /// Log evidence over no term, its prior included.
    pub(crate) gain: f64,
    /// Residuals.
    pub(crate) residuals: Vec<f64>,
}

/// Weighted products of columns (nuisances, terms, residual) over some rows.
#[derive(Clone)]
struct Gram(DMatrix<f64>);

impl<'a> Rows<'a> {
    /// Returns the same rows without columns for terms.
    pub(crate) fn without_terms(&self) -> Rows<'a> {
        let (drives, nuisances, springs) = (self.drives.clone(), self.nuisances.clone(), self.springs.clone());
        Rows { residuals: self.residuals, drives, nuisances, springs, terms: Vec::new(), groups: Vec::new() }
    }

    fn width(&self) -> usize {
        self.nuisances.len() + self.terms.len()
    }

    fn column(&self, k: usize) -> &[f64] {
        let n = self.nuisances.len();
        if k < n { self.nuisances[k] } else { &self.terms[k - n] }
    }

    /// Returns the products over the rows of one drive, rows weighted by what a residual there asks for.
    fn gram(&self, rows: &Range<usize>, at: &[f64]) -> Gram {
        let width = self.width();
        let mut matrix = DMatrix::zeros(rows.len(), width + 1);
        let roots: Vec<f64> = at[rows.clone()].iter().map(|z| (KAPPA * (NU + 1.0) / (NU + z * z)).sqrt()).collect();
        for k in 0..=width {
            let column = if k < width { self.column(k) } else { self.residuals };
            let pairs = matrix.column_mut(k);
            for ((cell, value), root) in pairs.into_iter().zip(&column[rows.clone()]).zip(&roots) {
                *cell = value * root;
            }
        }
        Gram(matrix.transpose() * &matrix)
    }

    fn grams(&self, at: &[f64]) -> Vec<Gram> {
        self.drives.iter().map(|rows| self.gram(rows, at)).collect()
    }

    /// Adds the priors: to the diagonal, and their pull to the last column.
    fn with_priors(&self, gram: &Gram) -> DMatrix<f64> {
        let (width, n) = (self.width(), self.nuisances.len());
        let mut matrix = gram.0.clone();
        for (k, spring) in self.springs.iter().enumerate() {
            let precision = 1.0 / (spring.sd * spring.sd);
            matrix[(k, k)] += precision;
            matrix[(k, width)] += precision * spring.offset;
            matrix[(width, k)] += precision * spring.offset;
        }
        for k in n..width {
            matrix[(k, k)] += 1.0;
        }
        matrix
    }

    /// Returns the best sets by the quadratic approximation at some weights, best first, with their gains.
    fn enumerate(&self, gram: &Gram, most: usize) -> Vec<(f64, Vec<usize>)> {
        let n = self.nuisances.len();
        let m = self.terms.len();
        let matrix = self.with_priors(gram);
        let head = matrix.view((0, 0), (n, n)).into_owned();
        let cross = matrix.view((0, n), (n, m + 1)).into_owned();
        let Some(factor) = head.cholesky() else { return Vec::new() };
        let rest = matrix.view((n, n), (m + 1, m + 1)) - cross.transpose() * factor.solve(&cross);
        let mut found = vec![(LOG_PRIOR[0], Vec::new())];
        let mut chosen = Vec::new();
        self.descend(&rest, 0, &mut chosen, &mut found);
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        found.truncate(most);
        found
    }

    fn descend(&self, rest: &DMatrix<f64>, from: usize, chosen: &mut Vec<usize>, found: &mut Vec<(f64, Vec<usize>)>) {
        let m = self.terms.len();
        for k in from..m {
            if chosen.iter().any(|&c| self.groups[c] == self.groups[k]) {
                continue;
            }
            chosen.push(k);
            if let Some(gain) = quadratic(rest, chosen, m) {
                found.push((gain + log_prior(chosen.len(), m), chosen.clone()));
            }
            if chosen.len() < MOST_TERMS {
                self.descend(rest, k + 1, chosen, found);
            }
            chosen.pop();
        }
    }

    /// Fits one set by repeated weighted least squares, over some of the drives.
    pub(crate) fn settle(&self, set: &[usize], start: &[f64], out: Option<usize>) -> Fitted {
        let (n, width) = (self.nuisances.len(), self.width());
        let index: Vec<usize> = (0..n).chain(set.iter().map(|k| n + k)).collect();
        let mut at = start.to_vec();
        let mut best: Option<(f64, DVector<f64>, Vec<f64>, f64)> = None;
        for _ in 0..STEPS {
            let kept = (0..self.drives.len()).filter(|d| Some(*d) != out);
            let mut sum = DMatrix::zeros(index.len() + 1, index.len() + 1);
            for drive in kept {
                sum += self.small(&index, &self.drives[drive], &at);
            }
            for (i, &k) in index.iter().enumerate() {
                let (precision, offset) =
                    if k < n { (1.0 / self.springs[k].sd.powi(2), self.springs[k].offset) } else { (1.0, 0.0) };
                sum[(i, i)] += precision;
                sum[(i, index.len())] += precision * offset;
            }
            let head = sum.view((0, 0), (index.len(), index.len())).into_owned();
            let pull = sum.view((0, index.len()), (index.len(), 1)).into_owned();
            let Some(factor) = head.cholesky() else { break };
            let moves = DVector::from_iterator(index.len(), factor.solve(&pull).iter().map(|v| -v));
            let residuals = self.moved(&index, &moves);
            let log_det = 2.0 * factor.l().diagonal().iter().map(|d| d.ln()).sum::<f64>();
            let value = self.objective(&index, &moves, &residuals, out);
            let better = best.as_ref().is_none_or(|b| value < b.0 - 1e-3);
            at.clone_from(&residuals);
            if better {
                best = Some((value, moves, residuals, log_det));
            } else {
                break;
            }
        }
        let (value, moves, residuals, log_det) =
            best.unwrap_or_else(|| (f64::INFINITY, DVector::zeros(index.len()), self.residuals.to_vec(), 0.0));
        let gain = -value - 0.5 * log_det + log_prior(set.len(), width - n);
        Fitted { set: set.to_vec(), moves, gain, residuals }
    }

    fn small(&self, index: &[usize], rows: &Range<usize>, at: &[f64]) -> DMatrix<f64> {
        let mut matrix = DMatrix::zeros(rows.len(), index.len() + 1);
        let roots: Vec<f64> = at[rows.clone()].iter().map(|z| (KAPPA * (NU + 1.0) / (NU + z * z)).sqrt()).collect();
        for i in 0..=index.len() {
            let column = index.get(i).map_or(self.residuals, |&k| self.column(k));
            for ((cell, value), root) in matrix.column_mut(i).iter_mut().zip(&column[rows.clone()]).zip(&roots) {
                *cell = value * root;
            }
        }
        matrix.transpose() * &matrix
    }

    fn moved(&self, index: &[usize], moves: &DVector<f64>) -> Vec<f64> {
        let mut residuals = self.residuals.to_vec();
        for (&k, by) in index.iter().zip(moves.iter()) {
            residuals.iter_mut().zip(self.column(k)).for_each(|(z, c)| *z += by * c);
        }
        // absent data stay absent
        residuals.iter_mut().zip(self.residuals).filter(|(_, z)| **z == 0.0).for_each(|(moved, _)| *moved = 0.0);
        residuals
    }

    fn objective(&self, index: &[usize], moves: &DVector<f64>, residuals: &[f64], out: Option<usize>) -> f64 {
        let n = self.nuisances.len();
        let prior = |(i, &k): (usize, &usize)| {
            if k < n {
                let spring = self.springs[k];
                0.5 * ((spring.offset + moves[i]) / spring.sd).powi(2)
            } else {
                0.5 * moves[i] * moves[i]
            }
        };
        let data: f64 = (0..self.drives.len())
            .filter(|d| Some(*d) != out)
            .map(|d| data_loss(&residuals[self.drives[d].clone()]))
            .sum();
        data + index.iter().enumerate().map(prior).sum::<f64>()
    }

    /// Returns the best sets of the port, fitted, best first, with gains over the fit without any term.
    pub(crate) fn search(&self, empty: &Fitted) -> Vec<Fitted> {
        let mut at = empty.residuals.clone();
        let mut best: Vec<Fitted> = Vec::new();
        for _ in 0..PASSES {
            let total = self.grams(&at).into_iter().reduce(|a, b| Gram(a.0 + b.0));
            let Some(total) = total else { break };
            let sets = self.enumerate(&total, KEPT_SETS);
            for (_, set) in sets.into_iter().filter(|(_, set)| !set.is_empty()) {
                if best.iter().all(|b| b.set != set) {
                    let mut fitted = self.settle(&set, &at, None);
                    fitted.gain -= empty.gain;
                    best.push(fitted);
                }
            }
            best.sort_by(|a, b| b.gain.total_cmp(&a.gain));
            let Some(first) = best.first() else { break };
            at.clone_from(&first.residuals);
        }
        best.truncate(2 * KEPT_SETS);
        best
    }

    /// Returns, drive by drive, the predictive log score that a set of terms gains there: log p(drive | other drives) as the
    /// evidence of all drives less that of the others, each fitted by itself.
    pub(crate) fn held_out(&self, fitted: &Fitted, empty: &Fitted) -> Vec<f64> {
        let of = |drive: usize| {
            let score = |whole: f64, set: &[usize], start: &[f64]| whole - self.settle(set, start, Some(drive)).gain;
            score(fitted.gain + empty.gain, &fitted.set, &fitted.residuals) - score(empty.gain, &[], &empty.residuals)
        };
        (0..self.drives.len()).map(of).collect()
    }

    /// Returns, for each term of a set, the share of refits without one drive in which it is kept with the same sign.
    pub(crate) fn stability(&self, fitted: &Fitted) -> Vec<f64> {
        let n = self.nuisances.len();
        let grams = self.grams(&fitted.residuals);
        let Some(total) = grams.iter().cloned().reduce(|a, b| Gram(a.0 + b.0)) else { return Vec::new() };
        let mut kept = vec![0.0; fitted.set.len()];
        for (drive, own) in grams.iter().enumerate() {
            let sets = self.enumerate(&Gram(&total.0 - &own.0), usize::MAX);
            let top = sets.first().map_or(0.0, |s| s.0);
            let all: f64 = sets.iter().map(|(gain, _)| (gain - top).exp()).sum();
            let refit = self.settle(&fitted.set, &fitted.residuals, Some(drive));
            for (place, term) in fitted.set.iter().enumerate() {
                let alike = |k: &usize| self.groups[*k] == self.groups[*term];
                let with: f64 =
                    sets.iter().filter(|(_, set)| set.iter().any(alike)).map(|(gain, _)| (gain - top).exp()).sum();
                let same = refit.moves[n + place] * fitted.moves[n + place] > 0.0;
                kept[place] += f64::from(u8::from(with / all >= 0.5 && same));
            }
        }
        kept.iter().map(|k| k / grams.len().max(1) as f64).collect()
    }
}

fn log_prior(terms: usize, of: usize) -> f64 {
    let choose = (0..terms).map(|k| ((of - k) as f64 / (k + 1) as f64).ln()).sum::<f64>();
    LOG_PRIOR[terms.min(MOST_TERMS)] - choose
}

/// Returns the log evidence of a set over no term; the last row and column of `rest` hold the residual.
fn quadratic(rest: &DMatrix<f64>, set: &[usize], residual: usize) -> Option<f64> {
    let k = set.len();
    let matrix = DMatrix::from_fn(k, k, |i, j| rest[(set[i], set[j])]);
    let pull = DVector::from_fn(k, |i, _| rest[(set[i], residual)]);
    let factor = matrix.cholesky()?;
    let log_det = 2.0 * factor.l().diagonal().iter().map(|d| d.ln()).sum::<f64>();
    Some(0.5 * pull.dot(&factor.solve(&pull)) - 0.5 * log_det)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two drives; the residual is 3 of the second term, a nuisance and a little of everything else.
    #[test]
    fn the_right_term_is_found_beside_a_nuisance() {
        let at = |k: usize, f: f64| ((k as f64 + 1.0) * f).sin();
        let count = 400;
        let column = |f: f64| (0..count).map(|k| at(k, f)).collect::<Vec<f64>>();
        let nuisance = column(0.31);
        let terms = vec![column(0.17), column(0.53), column(0.71)];
        let residuals: Vec<f64> =
            (0..count).map(|k| -3.0 * terms[1][k] - 0.5 * nuisance[k] + 0.3 * at(k, 1.9)).collect();
        let rows = Rows {
            residuals: &residuals,
            drives: vec![0..200, 200..400],
            nuisances: vec![&nuisance],
            springs: vec![Spring { offset: 0.0, sd: 1.0 }],
            terms,
            groups: vec!["a".to_owned(), "b".to_owned(), "c".to_owned()],
        };
        let empty = rows.settle(&[], &residuals, None);
        let found = rows.search(&empty);
        assert_eq!(found[0].set, [1]);
        assert!((found[0].moves[1] - 3.0).abs() < 0.1 && (found[0].moves[0] - 0.5).abs() < 0.1, "{:?}", found[0].moves);
        assert!(found[0].gain > 50.0);
        assert!(rows.held_out(&found[0], &empty).iter().all(|gain| *gain > 10.0));
        assert_eq!(rows.stability(&found[0]), [1.0]);
    }
}

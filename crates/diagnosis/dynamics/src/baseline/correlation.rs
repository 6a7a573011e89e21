//! How the residuals of one window of healthy drives go together, over channels and time, and what is left of residuals once
//! that is taken out.
//!
//! A slow drift is one draw, not eight; and where yaw rate and heading err together, as when the tyres are not the simulator's, their
//! difference still tells a latency between them. Residuals are multiplied by the inverse root of their correlation (the
//! symmetric one, so that each stays nearest to its own channel and block). The correlation found is drawn towards none
//! as far as its entries scatter (Ledoit, Wolf 2004).

use std::collections::BTreeMap;

use nalgebra::{DMatrix, SymmetricEigen};
use serde::{Deserialize, Serialize};

use super::discrepancy::CUT;
use crate::windows::{BLOCKS, EGO};

/// Residuals of a window.
pub(crate) const ROWS: usize = EGO * BLOCKS;
/// Windows that tell the same, for they overlap.
const SHARED: f64 = 2.0;
/// Least share of a residual's variance that may be taken for its own: shapes of effects are never quite the library's.
const LEAST_OWN: f64 = 0.25;

/// The correlation of the residuals of a window.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Correlation {
    /// Rows of a window, channel-major, that healthy drives had.
    pub rows: Vec<usize>,
    /// Correlations of these rows, below the diagonal, row by row.
    pub below: Vec<f64>,
}

impl Correlation {
    /// Learns from windows of residuals of unit size; absent ones are none.
    #[must_use]
    pub(crate) fn learn(windows: &[Vec<Option<f64>>]) -> Self {
        let seen = |row: &usize| windows.iter().any(|window| window[*row].is_some());
        let rows: Vec<usize> = (0..ROWS).filter(seen).collect();
        let mut found = Vec::new();
        let (mut scattered, mut squared) = (0.0, 0.0);
        for (i, a) in rows.iter().enumerate() {
            for b in &rows[..i] {
                let cut = |z: f64| z.clamp(-CUT, CUT);
                let pairs: Vec<[f64; 2]> = windows.iter().filter_map(|w| Some([cut(w[*a]?), cut(w[*b]?)])).collect();
                let mean =
                    |of: &dyn Fn(&[f64; 2]) -> f64| pairs.iter().map(of).sum::<f64>() / pairs.len().max(1) as f64;
                let sizes = (mean(&|p| p[0] * p[0]) * mean(&|p| p[1] * p[1])).sqrt();
                let r = if sizes > 0.0 { mean(&|p| p[0] * p[1]) / sizes } else { 0.0 };
                if sizes > 0.0 {
                    scattered += SHARED * mean(&|p| (p[0] * p[1] / sizes - r).powi(2)) / pairs.len() as f64;
                    squared += r * r;
                }
                found.push(r);
            }
        }
        let kept = if squared > 0.0 { (1.0 - scattered / squared).clamp(0.0, 1.0 - LEAST_OWN) } else { 0.0 };
        Self { rows, below: found.into_iter().map(|r| kept * r).collect() }
    }

    /// Tells whether the table has the size that it must have and nothing beyond what learning leaves in it.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        let count = self.rows.len();
        let rising = self.rows.windows(2).all(|pair| pair[0] < pair[1]) && self.rows.iter().all(|row| *row < ROWS);
        rising
            && self.below.len() == count * count.saturating_sub(1) / 2
            && self.below.iter().all(|r| r.abs() <= 1.0 - LEAST_OWN + 1e-9)
    }

    /// Tells whether nothing goes together.
    #[must_use]
    pub(crate) fn is_none(&self) -> bool {
        self.below.iter().all(|r| *r == 0.0)
    }

    fn between(&self, a: usize, b: usize) -> f64 {
        let place = |row: usize| self.rows.iter().position(|own| *own == row);
        match (place(a), place(b)) {
            _ if a == b => 1.0,
            (Some(i), Some(j)) => {
                let (high, low) = (i.max(j), i.min(j));
                self.below[high * (high - 1) / 2 + low]
            }
            _ => 0.0,
        }
    }

    /// Returns the roots for windows with some rows present.
    fn roots(&self, present: &[usize]) -> Roots {
        let matrix = DMatrix::from_fn(present.len(), present.len(), |i, j| self.between(present[i], present[j]));
        let SymmetricEigen { eigenvectors: v, eigenvalues } = SymmetricEigen::new(matrix);
        let root = |power: f64| {
            &v * DMatrix::from_diagonal(&eigenvalues.map(|e| e.max(LEAST_OWN).powf(power))) * v.transpose()
        };
        Roots { rows: present.to_vec(), out: root(-0.5), back: root(0.5) }
    }
}

/// The roots of a correlation for windows with the same rows.
#[derive(Debug)]
struct Roots {
    rows: Vec<usize>,
    out: DMatrix<f64>,
    back: DMatrix<f64>,
}

/// What takes the correlation out of the residuals of a model's windows.
#[derive(Debug)]
pub(crate) struct Whitening {
    roots: Vec<Roots>,
    /// By window, which roots; none where no row is present.
    of: Vec<Option<usize>>,
}

impl Whitening {
    /// Prepares for windows whose rows are present or not.
    pub(crate) fn new(correlation: &Correlation, present: &[bool]) -> Self {
        let mut known: BTreeMap<Vec<usize>, usize> = BTreeMap::new();
        let mut roots = Vec::new();
        let mut of = Vec::new();
        for window in present.chunks(ROWS) {
            let rows: Vec<usize> = (0..window.len()).filter(|row| window[*row]).collect();
            of.push((!rows.is_empty()).then(|| {
                *known.entry(rows).or_insert_with_key(|rows| {
                    roots.push(correlation.roots(rows));
                    roots.len() - 1
                })
            }));
        }
        Self { roots, of }
    }

    /// Takes the correlation out of the residuals of all windows.
    pub(crate) fn out(&self, residuals: &mut [f64]) {
        self.each(residuals, |roots| &roots.out);
    }

    /// Puts it in again.
    pub(crate) fn back(&self, residuals: &mut [f64]) {
        self.each(residuals, |roots| &roots.back);
    }

    fn each<'a>(&'a self, residuals: &mut [f64], root: impl Fn(&'a Roots) -> &'a DMatrix<f64>) {
        for (window, roots) in residuals.chunks_mut(ROWS).zip(&self.of) {
            let Some(roots) = roots.map(|k| &self.roots[k]) else { continue };
            let values = nalgebra::DVector::from_iterator(roots.rows.len(), roots.rows.iter().map(|row| window[*row]));
            let moved = root(roots) * values;
            roots.rows.iter().zip(moved.iter()).for_each(|(row, value)| window[*row] = *value);
        }
    }
}

#[cfg(test)]
mod tests {
    use ds_space::Draws;

    use super::*;

    fn windows(count: usize, drift: f64) -> Vec<Vec<Option<f64>>> {
        let draws = Draws::from_seed(7, "windows");
        let mut drawn = 0;
        let mut unit = || {
            drawn += 1;
            draws.normal(drawn)
        };
        let window = |_| {
            let common = unit() * drift.sqrt();
            (0..ROWS).map(|row| (row < 2 * BLOCKS).then(|| common + unit() * (1.0 - drift).sqrt())).collect()
        };
        (0..count).map(window).collect()
    }

    #[test]
    fn a_drift_is_found_and_independent_noise_is_left_alone() {
        let drifting = Correlation::learn(&windows(300, 0.6));
        assert!(drifting.is_sound());
        assert_eq!(drifting.rows, (0..2 * BLOCKS).collect::<Vec<_>>());
        // three quarters of what is in common, for a quarter stays each one's own
        assert!(drifting.below.iter().all(|r| (r - 0.45).abs() < 0.1), "{:?}", drifting.below);
        let independent = Correlation::learn(&windows(300, 0.0));
        assert!(independent.below.iter().all(|r| r.abs() < 0.1), "{:?}", independent.below);
        assert!(Correlation::learn(&[]).is_none());
    }

    #[test]
    fn a_common_shift_counts_less_and_a_difference_more() {
        let correlation = Correlation::learn(&windows(300, 0.6));
        let present: Vec<bool> = (0..ROWS).map(|row| row < 2 * BLOCKS).collect();
        let whitening = Whitening::new(&correlation, &present);
        let size = |of: &dyn Fn(usize) -> f64| {
            let mut residuals: Vec<f64> = (0..ROWS).map(|row| if present[row] { of(row) } else { 0.0 }).collect();
            whitening.out(&mut residuals);
            assert!(residuals.iter().zip(&present).all(|(z, present)| *present || *z == 0.0));
            residuals.iter().map(|z| z * z).sum::<f64>().sqrt() / (2.0 * BLOCKS as f64).sqrt()
        };
        assert!(size(&|_| 1.0) < 0.5);
        assert!(size(&|row| if row < BLOCKS { 1.0 } else { -1.0 }) > 1.2);
    }

    #[test]
    fn what_is_taken_out_can_be_put_in_again_also_where_rows_are_missing() {
        let correlation = Correlation::learn(&windows(300, 0.6));
        let present: Vec<bool> = (0..2 * ROWS).map(|k| k < 5 || (k > ROWS && k < ROWS + 12)).collect();
        let whitening = Whitening::new(&correlation, &present);
        let before: Vec<f64> = present.iter().enumerate().map(|(k, p)| if *p { k as f64 - 9.5 } else { 0.0 }).collect();
        let mut residuals = before.clone();
        whitening.out(&mut residuals);
        assert!(residuals.iter().zip(&before).any(|(a, b)| (a - b).abs() > 0.1));
        whitening.back(&mut residuals);
        assert!(residuals.iter().zip(&before).all(|(a, b)| (a - b).abs() < 1e-9));
    }
}

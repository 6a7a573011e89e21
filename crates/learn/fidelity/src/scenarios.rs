//! Features by scenario: what is drawn anew is a scenario with all its rows.

use ds_stats::{SampleError, frechet};
use nalgebra::DMatrix;

use crate::principal::Principal;

/// Features, one matrix per scenario: a row per frame, a column per feature.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Features(pub Vec<DMatrix<f64>>);

impl Features {
    /// Stacks the rows of the scenarios drawn.
    #[must_use]
    pub fn stacked(&self, picks: &[usize]) -> DMatrix<f64> {
        let rows: usize = picks.iter().map(|pick| self.0[*pick].nrows()).sum();
        let columns = self.0.iter().map(DMatrix::ncols).max().unwrap_or(0);
        let mut all = DMatrix::zeros(rows, columns);
        let mut at = 0;
        for pick in picks {
            let part = &self.0[*pick];
            all.view_mut((at, 0), part.shape()).copy_from(part);
            at += part.nrows();
        }
        all
    }

    /// Stacks the rows of all scenarios.
    #[must_use]
    pub fn all(&self) -> DMatrix<f64> {
        self.stacked(&(0..self.0.len()).collect::<Vec<_>>())
    }

    /// Brings all rows to the directions of a reduction.
    ///
    /// # Errors
    /// If the number of features differs.
    pub fn reduced(&self, principal: &Principal) -> Result<Self, SampleError> {
        self.0.iter().map(|part| principal.project(part)).collect::<Result<_, _>>().map(Self)
    }

    /// Returns the Fréchet distance from other features over the same scenarios; none where there are too few rows.
    #[must_use]
    pub fn distance(&self, other: &Self, picks: &[usize], shrinkage: f64) -> Option<f64> {
        frechet(&self.stacked(picks), &other.stacked(picks), shrinkage).ok()
    }
}

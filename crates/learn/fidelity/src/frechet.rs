//! The Fréchet distance between normal distributions fitted to two feature matrices (Dowson and Landau 1982):
//! |m1 - m2|² + tr(C1 + C2 - 2 (C1^1/2 C2 C1^1/2)^1/2), the symmetric form of the square root.
//!
//! Covariances are shrunk towards their diagonal by a stated share, so that few rows do not make them singular.
//! Units are those of the features, squared. Rows are observations, columns are features.

use ds_space::draw::Draws;
use nalgebra::{DMatrix, DVector};

/// Feature matrices that cannot be compared.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum FidelityError {
    /// The matrices have different features.
    #[error("feature counts differ: {0} and {1}")]
    Columns(usize, usize),
    /// A covariance needs two rows at least.
    #[error("too few rows: {0}, 2 are needed")]
    Rows(usize),
    /// A feature is not finite.
    #[error("feature is not finite: row {row}, column {column}")]
    NotFinite {
        /// Row of the first or second matrix.
        row: usize,
        /// Column.
        column: usize,
    },
}

/// A distance with its 90 % bootstrap interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Distance of the matrices as given.
    pub value: f64,
    /// Quantiles 0.05 and 0.95 over resampled rows.
    pub interval90: [f64; 2],
}

/// Returns the squared Fréchet distance; `shrinkage` in 0..=1 is the share of each covariance's off-diagonal removed.
///
/// # Errors
/// If the matrices have different columns, fewer than two rows or values that are not finite.
pub fn frechet(a: &DMatrix<f64>, b: &DMatrix<f64>, shrinkage: f64) -> Result<f64, FidelityError> {
    check(a, b)?;
    let ((mean_a, cov_a), (mean_b, cov_b)) = (moments(a, shrinkage), moments(b, shrinkage));
    let root = square_root(&cov_a);
    let cross = square_root(&(&root * &cov_b * &root));
    let spread = cov_a.trace() + cov_b.trace() - 2.0 * cross.trace();
    Ok((mean_a - mean_b).norm_squared() + spread.max(0.0))
}

/// Returns the distance with an interval from resampling rows of both matrices; `draws` of them.
///
/// # Errors
/// As [`frechet`].
pub fn frechet_interval(
    a: &DMatrix<f64>,
    b: &DMatrix<f64>,
    shrinkage: f64,
    (draws, seed): (u64, u64),
) -> Result<Interval, FidelityError> {
    let value = frechet(a, b, shrinkage)?;
    let source = Draws::from_seed(seed, "frechet_bootstrap");
    let resampled = |m: &DMatrix<f64>, offset: u64| {
        let rows: Vec<usize> =
            (0..m.nrows() as u64).map(|k| source.below(offset + k, m.nrows() as u64) as usize).collect();
        m.select_rows(rows.iter())
    };
    let mut values = Vec::new();
    for draw in 0..draws {
        let offset = draw * (a.nrows() + b.nrows()) as u64;
        values.push(frechet(&resampled(a, offset), &resampled(b, offset + a.nrows() as u64), shrinkage)?);
    }
    values.sort_by(f64::total_cmp);
    let at = |q: f64| values.get(((values.len() as f64 - 1.0) * q).round() as usize).copied().unwrap_or(value);
    Ok(Interval { value, interval90: [at(0.05), at(0.95)] })
}

fn check(a: &DMatrix<f64>, b: &DMatrix<f64>) -> Result<(), FidelityError> {
    if a.ncols() != b.ncols() {
        return Err(FidelityError::Columns(a.ncols(), b.ncols()));
    }
    for m in [a, b] {
        if m.nrows() < 2 {
            return Err(FidelityError::Rows(m.nrows()));
        }
        if let Some(at) = m.iter().position(|v| !v.is_finite()) {
            return Err(FidelityError::NotFinite { row: at % m.nrows(), column: at / m.nrows() });
        }
    }
    Ok(())
}

fn moments(m: &DMatrix<f64>, shrinkage: f64) -> (DVector<f64>, DMatrix<f64>) {
    let mean = m.row_mean().transpose();
    let mut centred = m.clone();
    for mut row in centred.row_iter_mut() {
        row -= mean.transpose();
    }
    let mut covariance = centred.transpose() * &centred / (m.nrows() as f64 - 1.0);
    let diagonal = covariance.diagonal();
    covariance *= 1.0 - shrinkage;
    covariance.set_diagonal(&diagonal);
    (mean, covariance)
}

/// Returns the square root of a symmetric matrix; eigenvalues below zero by rounding count as zero.
fn square_root(m: &DMatrix<f64>) -> DMatrix<f64> {
    let symmetric = (m + m.transpose()) * 0.5;
    let eigen = symmetric.symmetric_eigen();
    let roots = DMatrix::from_diagonal(&eigen.eigenvalues.map(|v| v.max(0.0).sqrt()));
    &eigen.eigenvectors * roots * eigen.eigenvectors.transpose()
}

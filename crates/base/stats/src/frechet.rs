//! The Fréchet distance between normal distributions fitted to two feature matrices (Dowson and Landau 1982):
//! |m1 - m2|² + tr(C1 + C2 - 2 (C1^1/2 C2 C1^1/2)^1/2), the symmetric form of the square root.
//!
//! Covariances are shrunk towards their diagonal by a stated share, so that few rows do not make them singular.
//! Units are those of the features, squared. Rows are observations, columns are features.

use nalgebra::{DMatrix, DVector};

/// Feature matrices that cannot be compared.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum SampleError {
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

/// Returns the squared Fréchet distance; `shrinkage` in 0..=1 is the share of each covariance's off-diagonal removed.
///
/// # Errors
/// If the matrices have different columns, fewer than two rows or values that are not finite.
pub fn frechet(a: &DMatrix<f64>, b: &DMatrix<f64>, shrinkage: f64) -> Result<f64, SampleError> {
    check(a, b)?;
    let ((mean_a, cov_a), (mean_b, cov_b)) = (moments(a, shrinkage), moments(b, shrinkage));
    let root = square_root(&cov_a);
    let cross = square_root(&(&root * &cov_b * &root));
    let spread = cov_a.trace() + cov_b.trace() - 2.0 * cross.trace();
    Ok((mean_a - mean_b).norm_squared() + spread.max(0.0))
}

fn check(a: &DMatrix<f64>, b: &DMatrix<f64>) -> Result<(), SampleError> {
    if a.ncols() != b.ncols() {
        return Err(SampleError::Columns(a.ncols(), b.ncols()));
    }
    for m in [a, b] {
        if m.nrows() < 2 {
            return Err(SampleError::Rows(m.nrows()));
        }
        if let Some(at) = m.iter().position(|v| !v.is_finite()) {
            return Err(SampleError::NotFinite { row: at % m.nrows(), column: at / m.nrows() });
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

//! The Fréchet distance of normal distributions fitted to rows of features (Dowson and Landau 1982):
//! |m1 - m2|² + tr(C1 + C2 - 2 (C1 C2)^1/2), covariances with divisor n - 1.
//!
//! Of whole sets the trace of the root is the sum of the singular values of R1 R2ᵀ, where centred rows / √(n - 1) = Q R:
//! no covariance is formed, so deficient rank costs no digits. Of resamples, which are many, it is taken from moments by
//! eigenvalues. Units are those of the features, squared. Rows are observations, columns are features.

mod moments;

use nalgebra::{DMatrix, DVector};

pub use moments::{Moments, Rooted};

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

/// A normal distribution fitted to rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Fitted {
    mean: DVector<f64>,
    /// R with RᵀR = covariance, at most as many rows as columns.
    factor: DMatrix<f64>,
}

impl Fitted {
    /// Fits; `shrinkage` in 0..=1 is the share of the covariance's off-diagonal that is removed, 0 for the covariance itself.
    ///
    /// # Errors
    /// If there are fewer than two rows or a value is not finite.
    pub fn of(rows: &DMatrix<f64>, shrinkage: f64) -> Result<Self, SampleError> {
        if rows.nrows() < 2 {
            return Err(SampleError::Rows(rows.nrows()));
        }
        if let Some(at) = rows.iter().position(|v| !v.is_finite()) {
            return Err(SampleError::NotFinite { row: at % rows.nrows(), column: at / rows.nrows() });
        }
        let mean = rows.row_mean();
        let mut centred = rows.clone();
        centred.row_iter_mut().for_each(|mut row| row -= &mean);
        centred /= (rows.nrows() as f64 - 1.0).sqrt();
        if shrinkage > 0.0 {
            // (1 - s) XᵀX + s diag XᵀX is the product of these rows with themselves.
            let own = DMatrix::from_diagonal(&DVector::from_iterator(
                rows.ncols(),
                centred.column_iter().map(|column| (shrinkage * column.norm_squared()).sqrt()),
            ));
            let kept = centred.nrows();
            centred *= (1.0 - shrinkage).sqrt();
            centred = centred.resize_vertically(kept + own.nrows(), 0.0);
            centred.rows_mut(kept, own.nrows()).copy_from(&own);
        }
        Ok(Self { mean: mean.transpose(), factor: centred.qr().r() })
    }

    /// Returns the sum of the variances of all features: the trace of the covariance.
    #[must_use]
    pub fn variance(&self) -> f64 {
        self.factor.norm_squared()
    }

    /// Returns the eigenvalues of the covariance that may differ from zero.
    #[must_use]
    pub fn spectrum(&self) -> Vec<f64> {
        self.factor.singular_values().iter().map(|value| value * value).collect()
    }

    /// Returns the squared Fréchet distance from another distribution.
    ///
    /// # Errors
    /// If the features differ.
    pub fn frechet(&self, other: &Self) -> Result<f64, SampleError> {
        if self.mean.len() != other.mean.len() {
            return Err(SampleError::Columns(self.mean.len(), other.mean.len()));
        }
        let root = (&self.factor * other.factor.transpose()).singular_values().sum();
        let spread = self.variance() + other.variance() - 2.0 * root;
        Ok((&self.mean - &other.mean).norm_squared() + spread.max(0.0))
    }
}

/// Returns the share of the covariance's off-diagonal that its own scatter asks to remove, 0 to 1: what of its square is scatter of
/// the entries (Ledoit and Wolf 2004, towards the diagonal as in Schäfer and Strimmer 2005).
#[must_use]
pub fn shrinkage(rows: &DMatrix<f64>) -> f64 {
    let (count, mean) = (rows.nrows() as f64, rows.row_mean());
    let centred = DMatrix::from_fn(rows.nrows(), rows.ncols(), |row, column| rows[(row, column)] - mean[column]);
    let (mut scattered, mut squared) = (0.0, 0.0);
    for a in 0..rows.ncols() {
        for b in 0..a {
            let products: Vec<f64> =
                centred.column(a).iter().zip(centred.column(b).iter()).map(|(x, y)| x * y).collect();
            let middle = products.iter().sum::<f64>() / count;
            scattered += count / (count - 1.0).powi(3) * products.iter().map(|p| (p - middle).powi(2)).sum::<f64>();
            squared += (middle * count / (count - 1.0)).powi(2);
        }
    }
    if squared > 0.0 { (scattered / squared).clamp(0.0, 1.0) } else { 0.0 }
}

/// Returns the squared Fréchet distance of two sets of rows; `shrinkage` in 0..=1 is the share of each covariance's
/// off-diagonal removed.
///
/// # Errors
/// If the matrices have different columns, fewer than two rows or values that are not finite.
pub fn frechet(a: &DMatrix<f64>, b: &DMatrix<f64>, shrinkage: f64) -> Result<f64, SampleError> {
    if a.ncols() != b.ncols() {
        return Err(SampleError::Columns(a.ncols(), b.ncols()));
    }
    Fitted::of(a, shrinkage)?.frechet(&Fitted::of(b, shrinkage)?)
}

#[cfg(test)]
mod tests {
    use ds_space::Draws;

    use super::*;

    #[test]
    fn scatter_is_removed_and_what_goes_together_is_kept() {
        let draws = Draws::from_seed(5, "shrinkage");
        let normal = |row: usize, column: usize| draws.normal((row * 8 + column) as u64);
        let apart = shrinkage(&DMatrix::from_fn(40, 6, normal));
        let together = shrinkage(&DMatrix::from_fn(400, 6, |row, column| normal(row, 7) + 0.1 * normal(row, column)));
        assert!(apart > 0.6 && together < 0.02, "{apart} {together}");
        assert_eq!(shrinkage(&DMatrix::from_element(5, 3, 2.0)), 0.0);
    }
}

//! The same distance from moments of parts (scenarios): a resample is a weighted sum of them, not of all rows again.
//!
//! The root's trace is that of (C1^½ C2 C1^½)^½ by eigenvalues, exact to 1e-7 of the variance at deficient rank: enough
//! for the spread of resamples, not for a value. Rows should lie near the origin, or sums of squares lose digits.

use nalgebra::{DMatrix, DVector};

/// Count, sum and sum of outer products of some rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Moments {
    count: f64,
    sum: DVector<f64>,
    outer: DMatrix<f64>,
}

/// What is compared with: mean, trace and root of the covariance of moments.
#[derive(Debug, Clone, PartialEq)]
pub struct Rooted {
    mean: DVector<f64>,
    variance: f64,
    root: DMatrix<f64>,
}

impl Moments {
    /// Sums up rows after `origin` was taken from each.
    #[must_use]
    pub fn of(rows: &DMatrix<f64>, origin: &DVector<f64>) -> Self {
        let mut moved = rows.clone();
        moved.row_iter_mut().for_each(|mut row| row -= origin.transpose());
        Self { count: rows.nrows() as f64, sum: moved.row_sum().transpose(), outer: moved.transpose() * &moved }
    }

    /// Sums up the parts that are drawn, each as often as it is drawn; none for no parts.
    #[must_use]
    pub fn drawn(parts: &[Self], picks: &[usize]) -> Option<Self> {
        let mut times = vec![0u32; parts.len()];
        picks.iter().for_each(|pick| times[*pick] += 1);
        let columns = parts.first()?.sum.len();
        let mut all = Self { count: 0.0, sum: DVector::zeros(columns), outer: DMatrix::zeros(columns, columns) };
        for (part, times) in parts.iter().zip(times).filter(|(_, times)| *times > 0) {
            let times = f64::from(times);
            all.count += times * part.count;
            all.sum.axpy(times, &part.sum, 1.0);
            all.outer.zip_apply(&part.outer, |sum, value| *sum += times * value);
        }
        Some(all)
    }

    fn fitted(&self) -> Option<(DVector<f64>, DMatrix<f64>)> {
        if self.count < 2.0 {
            return None;
        }
        let mean = &self.sum / self.count;
        let mut covariance = self.outer.clone();
        covariance.ger(-self.count, &mean, &mean, 1.0);
        covariance /= self.count - 1.0;
        Some((mean, covariance))
    }

    /// Prepares these moments to be compared with; none for fewer than two rows.
    #[must_use]
    pub fn rooted(&self) -> Option<Rooted> {
        let (mean, covariance) = self.fitted()?;
        let variance = covariance.trace();
        let eigen = covariance.symmetric_eigen();
        let roots = DMatrix::from_diagonal(&eigen.eigenvalues.map(|value| value.max(0.0).sqrt()));
        let root = &eigen.eigenvectors * roots * eigen.eigenvectors.transpose();
        Some(Rooted { mean, variance, root })
    }
}

impl Rooted {
    /// Returns the trace of the covariance.
    #[must_use]
    pub fn variance(&self) -> f64 {
        self.variance
    }

    /// Returns the squared Fréchet distance from other moments of as many features; none for fewer than two rows.
    #[must_use]
    pub fn frechet(&self, other: &Moments) -> Option<f64> {
        let (mean, covariance) = other.fitted()?;
        let product = &self.root * &covariance * &self.root;
        let symmetric = (&product + product.transpose()) * 0.5;
        let root: f64 = symmetric.symmetric_eigenvalues().iter().map(|value| value.max(0.0).sqrt()).sum();
        let spread = self.variance + covariance.trace() - 2.0 * root;
        Some((&self.mean - mean).norm_squared() + spread.max(0.0))
    }
}

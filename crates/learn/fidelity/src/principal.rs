//! Principal directions of a feature matrix: each feature brought to unit deviation, then the directions of greatest
//! variance (Pearson 1901). Fitted once, on what is compared with; everything else is only projected.

use nalgebra::{DMatrix, DVector};

use ds_stats::{SampleError, upper_median};

/// A fitted reduction.
#[derive(Debug, Clone, PartialEq)]
pub struct Principal {
    mean: DVector<f64>,
    deviation: DVector<f64>,
    /// One direction per column, the greatest variance first.
    directions: DMatrix<f64>,
}

/// Features that vary less than this do not count.
const LEAST_DEVIATION: f64 = 1e-6;
/// Features that vary less than this share of the median feature count as if they varied so much: else one that hardly
/// ever moves in what is compared with would outweigh all others as soon as it moves elsewhere.
const LEAST_SHARE: f64 = 0.05;

impl Principal {
    /// Fits at most `most` directions to the rows of a matrix; features that do not vary count nothing.
    ///
    /// # Errors
    /// If there are fewer than two rows or a value is not finite.
    pub fn fit(rows: &DMatrix<f64>, most: usize) -> Result<Self, SampleError> {
        if rows.nrows() < 2 {
            return Err(SampleError::Rows(rows.nrows()));
        }
        if let Some(at) = rows.iter().position(|value| !value.is_finite()) {
            return Err(SampleError::NotFinite { row: at % rows.nrows(), column: at / rows.nrows() });
        }
        let mean = rows.row_mean().transpose();
        let deviation = rows.row_variance().transpose().map(f64::sqrt);
        let mut varied: Vec<f64> = deviation.iter().copied().filter(|value| *value >= LEAST_DEVIATION).collect();
        let floor = LEAST_SHARE * upper_median(&mut varied).unwrap_or(0.0);
        let deviation = deviation.map(|value| if value < LEAST_DEVIATION { value } else { value.max(floor) });
        let mut fitted = Self { mean, deviation, directions: DMatrix::zeros(rows.ncols(), 0) };
        let standard = fitted.standardised(rows);
        let covariance = standard.transpose() * &standard / (rows.nrows() as f64 - 1.0);
        let eigen = covariance.symmetric_eigen();
        let mut order: Vec<usize> = (0..rows.ncols()).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]).then(a.cmp(b)));
        order.truncate(most);
        fitted.directions = DMatrix::from_fn(rows.ncols(), order.len(), |row, column| {
            let direction = eigen.eigenvectors.column(order[column]);
            // The sign of an eigenvector is arbitrary: the largest component is made positive.
            let largest = direction.iamax();
            direction[row] * direction[largest].signum()
        });
        Ok(fitted)
    }

    /// Brings rows to the fitted directions.
    ///
    /// # Errors
    /// If the number of features differs.
    pub fn project(&self, rows: &DMatrix<f64>) -> Result<DMatrix<f64>, SampleError> {
        if rows.ncols() != self.mean.len() {
            return Err(SampleError::Columns(self.mean.len(), rows.ncols()));
        }
        Ok(self.standardised(rows) * &self.directions)
    }

    fn standardised(&self, rows: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(rows.nrows(), rows.ncols(), |row, column| {
            let deviation = self.deviation[column];
            if deviation < LEAST_DEVIATION { 0.0 } else { (rows[(row, column)] - self.mean[column]) / deviation }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_feature_that_hardly_moves_does_not_outweigh_the_others() {
        let wave = |row: usize, column: usize| ((row * (column + 3)) as f64 * 0.7).sin();
        let rows = DMatrix::from_fn(200, 4, |row, column| match column {
            3 => f64::from(u8::from(row == 7)) * 0.01,
            _ => wave(row, column),
        });
        let fitted = Principal::fit(&rows, 4).expect("fits");
        // As far out as the others ever are, which is a thousand of its own deviations.
        let elsewhere = DMatrix::from_row_slice(1, 4, &[0.0, 0.0, 0.0, 1.0]);
        let far = fitted.project(&elsewhere).expect("projects").norm();
        assert!(far < 100.0, "{far}");
    }

    #[test]
    fn the_direction_of_greatest_variance_comes_first() {
        // Features 0 and 1 move together, 2 moves by itself, 3 does not move at all.
        let rows = DMatrix::from_fn(40, 4, |row, column| match column {
            0 => row as f64,
            1 => 5.0 - 3.0 * row as f64,
            2 => {
                if row % 2 == 0 {
                    1.0
                } else {
                    -1.0
                }
            }
            _ => 7.0,
        });
        let fitted = Principal::fit(&rows, 2).expect("fits");
        let projected = fitted.project(&rows).expect("projects");
        assert_eq!(projected.shape(), (40, 2));
        let variance = |column: usize| projected.column(column).variance();
        assert!((variance(0) - 2.0 * 39.0 / 40.0).abs() < 0.1 && (variance(1) - 1.0).abs() < 0.1, "{projected}");
        assert!(projected.column(0).dot(&projected.column(1)).abs() < 3.0, "directions are not correlated");
        let other = DMatrix::from_element(3, 4, 7.0);
        assert_eq!(fitted.project(&other).expect("projects").nrows(), 3);
    }

    #[test]
    fn what_has_no_directions_is_refused() {
        assert_eq!(Principal::fit(&DMatrix::zeros(1, 3), 2), Err(SampleError::Rows(1)));
        let fitted = Principal::fit(&DMatrix::from_fn(4, 3, |r, c| (r * c) as f64), 2).expect("fits");
        assert_eq!(fitted.project(&DMatrix::zeros(2, 4)), Err(SampleError::Columns(3, 4)));
        let mut spoiled = DMatrix::zeros(4, 3);
        spoiled[(1, 2)] = f64::INFINITY;
        assert_eq!(Principal::fit(&spoiled, 2), Err(SampleError::NotFinite { row: 1, column: 2 }));
    }
}

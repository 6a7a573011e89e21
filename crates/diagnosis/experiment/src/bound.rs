//! How much of what is unknown one log would tell: the lower bound of the mutual information between explanation and data
//! when every explanation predicts a normal distribution (Kolchinsky, Tracey 2017, from Bhattacharyya distances):
//! I ≥ -Σ p_a ln Σ p_b exp(-β_ab), β = Δᵀ C̄⁻¹ Δ / 8 + ½ ln(|C̄| / √(|C_a| |C_b|)), C̄ = (C_a + C_b) / 2.
//!
//! Covariances are a diagonal and a few columns, so that inverses and determinants are those of small matrices (Woodbury).

use nalgebra::{DMatrix, DVector};

/// What one explanation predicts of a log.
pub(crate) struct Normal {
    /// Mean.
    pub(crate) mean: Vec<f64>,
    /// Diagonal of the covariance.
    pub(crate) diagonal: Vec<f64>,
    /// Columns whose outer products are added to it.
    pub(crate) columns: Vec<Vec<f64>>,
}

/// Returns the Bhattacharyya distance of two predictions.
#[must_use]
pub(crate) fn distance(a: &Normal, b: &Normal) -> f64 {
    let half = 0.5_f64.sqrt();
    let scaled = |column: &Vec<f64>| column.iter().map(|c| half * c).collect::<Vec<f64>>();
    let middle = Normal {
        mean: a.mean.iter().zip(&b.mean).map(|(a, b)| a - b).collect(),
        diagonal: a.diagonal.iter().zip(&b.diagonal).map(|(a, b)| 0.5 * (a + b)).collect(),
        columns: a.columns.iter().chain(&b.columns).map(scaled).collect(),
    };
    let small = Small::of(&middle);
    let quadratic = small.quadratic(&middle);
    let determinants = small.log_determinant - 0.5 * (Small::of(a).log_determinant + Small::of(b).log_determinant);
    (0.125 * quadratic + 0.5 * determinants).max(0.0)
}

/// Returns the bound, nat, for explanations of some probabilities and their distances.
#[must_use]
pub(crate) fn information(probabilities: &[f64], distances: &[Vec<f64>]) -> f64 {
    let of = |(p, row): (&f64, &Vec<f64>)| {
        let alike: f64 = probabilities.iter().zip(row).map(|(p, beta)| p * (-beta).exp()).sum();
        if *p > 0.0 { -p * alike.ln() } else { 0.0 }
    };
    probabilities.iter().zip(distances).map(of).sum()
}

/// Returns what is unknown beforehand, nat.
#[must_use]
pub(crate) fn entropy(probabilities: &[f64]) -> f64 {
    probabilities.iter().filter(|p| **p > 0.0).map(|p| -p * p.ln()).sum()
}

/// The small matrix of a covariance D + U Uᵀ: I + Uᵀ D⁻¹ U by its Cholesky factor.
struct Small {
    factor: nalgebra::Cholesky<f64, nalgebra::Dyn>,
    log_determinant: f64,
}

impl Small {
    fn of(normal: &Normal) -> Self {
        let count = normal.columns.len();
        let over =
            |a: &[f64], b: &[f64]| a.iter().zip(b).zip(&normal.diagonal).map(|((a, b), d)| a * b / d).sum::<f64>();
        let mut matrix: DMatrix<f64> = DMatrix::identity(count, count);
        for i in 0..count {
            for j in 0..=i {
                let value = over(&normal.columns[i], &normal.columns[j]);
                matrix[(i, j)] += value;
                matrix[(j, i)] = matrix[(i, j)];
            }
        }
        let factor = matrix.cholesky().expect("the identity and a Gram matrix are positive definite");
        let own: f64 = normal.diagonal.iter().map(|d| d.ln()).sum();
        let roots: f64 = factor.l_dirty().diagonal().iter().map(|root: &f64| root.ln()).sum();
        let log_determinant = own + 2.0 * roots;
        Self { factor, log_determinant }
    }

    /// Returns the mean's square in the metric of the inverse covariance.
    fn quadratic(&self, normal: &Normal) -> f64 {
        let weighted: Vec<f64> = normal.mean.iter().zip(&normal.diagonal).map(|(m, d)| m / d).collect();
        let whole: f64 = normal.mean.iter().zip(&weighted).map(|(m, w)| m * w).sum();
        let dot = |column: &Vec<f64>| column.iter().zip(&weighted).map(|(c, w)| c * w).sum::<f64>();
        let along = DVector::from_iterator(normal.columns.len(), normal.columns.iter().map(dot));
        whole - along.dot(&self.factor.solve(&along))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dense(normal: &Normal) -> DMatrix<f64> {
        let mut matrix = DMatrix::from_diagonal(&DVector::from_vec(normal.diagonal.clone()));
        for column in &normal.columns {
            let column = DVector::from_vec(column.clone());
            matrix += &column * column.transpose();
        }
        matrix
    }

    #[test]
    fn the_distance_is_that_of_dense_matrices() {
        let a = Normal {
            mean: vec![1.0, -2.0, 0.5, 3.0],
            diagonal: vec![1.0, 2.0, 0.5, 4.0],
            columns: vec![vec![1.0, 0.0, 2.0, -1.0]],
        };
        let b = Normal {
            mean: vec![0.0, 1.0, 0.5, -1.0],
            diagonal: vec![0.7, 2.5, 1.5, 1.0],
            columns: vec![vec![0.3, 1.0, 0.0, 1.0], vec![0.0, 2.0, -1.0, 0.0]],
        };
        let (first, second) = (dense(&a), dense(&b));
        let middle = (&first + &second) * 0.5;
        let apart = DVector::from_iterator(4, a.mean.iter().zip(&b.mean).map(|(a, b)| a - b));
        let inverse = middle.clone().try_inverse().expect("it is definite");
        let expected = 0.125 * apart.dot(&(inverse * &apart))
            + 0.5 * (middle.determinant() / (first.determinant() * second.determinant()).sqrt()).ln();
        assert!((distance(&a, &b) - expected).abs() < 1e-10, "{} {expected}", distance(&a, &b));
        assert!(distance(&a, &a).abs() < 1e-10);
    }

    #[test]
    fn the_bound_lies_between_nothing_and_all_that_is_unknown() {
        let probabilities = [0.5, 0.3, 0.2];
        let row = |i: usize, beta: f64| (0..3).map(|j| if i == j { 0.0 } else { beta }).collect::<Vec<f64>>();
        let at = |beta: f64| information(&probabilities, &[row(0, beta), row(1, beta), row(2, beta)]);
        assert!(at(0.0).abs() < 1e-12);
        assert!((at(50.0) - entropy(&probabilities)).abs() < 1e-9);
        assert!(at(0.2) < at(0.4) && at(0.4) < entropy(&probabilities));
    }
}

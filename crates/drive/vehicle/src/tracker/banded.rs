//! Solves symmetric positive definite systems with two bands beside the diagonal (LDLᵀ, in order, O(n)).

/// The lower bands of a symmetric matrix: `rows[i]` holds entries (i, i), (i, i−1), (i, i−2).
#[derive(Debug, Clone)]
pub(super) struct Banded {
    rows: Vec<[f64; 3]>,
}

/// Smaller pivots are rounding noise of a singular system.
const SMALLEST_PIVOT: f64 = 1e-14;

impl Banded {
    /// Makes a zero matrix.
    pub(super) fn zeros(size: usize) -> Self {
        Self { rows: vec![[0.0; 3]; size] }
    }

    /// Adds `weight · g·gᵀ` where `g` has the given entries from index `first` on (at most three).
    pub(super) fn add_square(&mut self, first: usize, entries: &[f64], weight: f64) {
        for (i, a) in entries.iter().enumerate() {
            for (j, b) in entries[..=i].iter().enumerate() {
                self.rows[first + i][i - j] += weight * a * b;
            }
        }
    }

    /// Returns the solution for a right-hand side of the same size.
    pub(super) fn solve(mut self, mut right: Vec<f64>) -> Vec<f64> {
        let size = self.rows.len();
        // rows[i] becomes [d_i, l_(i,i-1), l_(i,i-2)].
        for i in 0..size {
            let [diagonal, first, second] = self.rows[i];
            let l2 = if i >= 2 { second / self.rows[i - 2][0] } else { 0.0 };
            let l1 = if i >= 1 {
                let shared = if i >= 2 { l2 * self.rows[i - 2][0] * self.rows[i - 1][1] } else { 0.0 };
                (first - shared) / self.rows[i - 1][0]
            } else {
                0.0
            };
            let mut pivot = diagonal;
            if i >= 1 {
                pivot -= l1 * l1 * self.rows[i - 1][0];
                right[i] -= l1 * right[i - 1];
            }
            if i >= 2 {
                pivot -= l2 * l2 * self.rows[i - 2][0];
                right[i] -= l2 * right[i - 2];
            }
            self.rows[i] = [pivot.max(SMALLEST_PIVOT), l1, l2];
        }
        for i in (0..size).rev() {
            right[i] /= self.rows[i][0];
            if i + 1 < size {
                right[i] -= self.rows[i + 1][1] * right[i + 1];
            }
            if i + 2 < size {
                right[i] -= self.rows[i + 2][2] * right[i + 2];
            }
        }
        right
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_solution_gives_the_right_hand_side_back(
            squares in proptest::collection::vec((-2.0..2.0, -2.0..2.0, -2.0..2.0), 1..30),
            seed in -5.0..5.0f64,
        ) {
            let size = squares.len() + 2;
            let mut matrix = Banded::zeros(size);
            let mut dense = vec![vec![0.0; size]; size];
            for (i, row) in dense.iter_mut().enumerate() {
                matrix.add_square(i, &[1.0], 1.0);
                row[i] += 1.0;
            }
            for (first, (a, b, c)) in squares.iter().enumerate() {
                let entries: [f64; 3] = [*a, *b, *c];
                matrix.add_square(first, &entries, 0.5);
                for i in 0..3 {
                    for j in 0..3 {
                        dense[first + i][first + j] += 0.5 * entries[i] * entries[j];
                    }
                }
            }
            let right: Vec<f64> = (0..size).map(|i| (i as f64 * 0.7 + seed).sin()).collect();
            let solution = matrix.solve(right.clone());
            for i in 0..size {
                let product: f64 = dense[i].iter().zip(&solution).map(|(a, b)| a * b).sum();
                prop_assert!((product - right[i]).abs() < 1e-9);
            }
        }
    }
}

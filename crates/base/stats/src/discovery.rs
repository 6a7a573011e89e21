//! Corrections of p-values for being tested together: of the false discovery rate (Benjamini and Hochberg 1995), and of
//! the chance of any false one (Holm 1979).

/// Returns the q-values of p-values of `tested` tests, in the order given; tests that are not listed count as p = 1.
#[must_use]
pub fn false_discovery(p_values: &[f64], tested: usize) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p_values.len()).collect();
    order.sort_by(|a, b| p_values[*a].total_cmp(&p_values[*b]));
    let mut corrected = vec![0.0; p_values.len()];
    let mut least: f64 = 1.0;
    for (rank, &index) in order.iter().enumerate().rev() {
        least = least.min(p_values[index] * tested as f64 / (rank + 1) as f64);
        corrected[index] = least;
    }
    corrected
}

/// Returns the p-values corrected for the chance of any false one, in the order given.
#[must_use]
pub fn holm(p_values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p_values.len()).collect();
    order.sort_by(|a, b| p_values[*a].total_cmp(&p_values[*b]));
    let mut corrected = vec![0.0; p_values.len()];
    let mut largest = 0.0f64;
    for (rank, &index) in order.iter().enumerate() {
        largest = largest.max((p_values.len() - rank) as f64 * p_values[index]).min(1.0);
        corrected[index] = largest;
    }
    corrected
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(found: &[f64], expected: &[f64]) {
        assert_eq!(found.len(), expected.len());
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}, not {expected:?}");
    }

    #[test]
    fn q_values_step_up() {
        // Sorted 0.01, 0.02, 0.03, 0.6 times 4/1, 4/2, 4/3, 4/4 = 0.04, 0.04, 0.04, 0.6.
        near(&false_discovery(&[0.03, 0.6, 0.01, 0.02], 4), &[0.04, 0.6, 0.04, 0.04]);
        // Sorted 0.001, 0.4 times 2/1, 2/2; the same among ten tests.
        near(&false_discovery(&[0.4, 0.001], 2), &[0.4, 0.002]);
        near(&false_discovery(&[0.4, 0.001], 10), &[1.0, 0.01]);
        near(&false_discovery(&[], 3), &[]);
    }

    #[test]
    fn holm_corrects_in_steps() {
        // Sorted 0.01, 0.02, 0.03, 0.6 times 4, 3, 2, 1 = 0.04, 0.06, 0.06, 0.6; the third may not fall below the second.
        near(&holm(&[0.03, 0.6, 0.01, 0.02]), &[0.06, 0.6, 0.04, 0.06]);
        near(&holm(&[0.7, 0.9]), &[1.0, 1.0]);
        near(&holm(&[]), &[]);
    }
}

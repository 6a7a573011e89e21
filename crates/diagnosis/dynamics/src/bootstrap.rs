//! Moving-block bootstrap over windows: draws of window weights that keep neighbouring windows of a drive together.

use ds_space::Draws;

use crate::settings::BOOTSTRAP_DRAWS;

/// Windows per block: three windows span more than twice the two seconds over which residuals stay alike.
const BLOCK: usize = 3;

/// Draws of how often each window is used; `drives[w]` is the drive of window `w`, drives are contiguous.
#[must_use]
pub fn weights(drives: &[usize], purpose: &str) -> Vec<Vec<f64>> {
    let draws = Draws::from_seed(1, purpose);
    let mut counter = 0;
    let mut spans: Vec<(usize, usize)> = Vec::new();
    for (k, drive) in drives.iter().enumerate() {
        match spans.last_mut() {
            Some(span) if drives[span.0] == *drive => span.1 = k + 1,
            _ => spans.push((k, k + 1)),
        }
    }
    (0..BOOTSTRAP_DRAWS)
        .map(|_| {
            let mut weights = vec![0.0; drives.len()];
            for &(start, end) in &spans {
                let count = end - start;
                let mut drawn = 0;
                while drawn < count {
                    let first = (draws.uniform(counter) * count as f64) as usize;
                    counter += 1;
                    for k in 0..BLOCK.min(count - drawn) {
                        weights[start + (first + k) % count] += 1.0;
                    }
                    drawn += BLOCK;
                }
            }
            weights
        })
        .collect()
}

/// Returns a quantile of values, by straight lines between order statistics.
#[must_use]
pub fn quantile(values: &mut [f64], share: f64) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    values.sort_by(f64::total_cmp);
    crate::smooth::between(values, share * (values.len() - 1) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_draw_keeps_the_size_of_every_drive() {
        let drives = [0, 0, 0, 0, 0, 1, 1, 1, 1];
        for draw in weights(&drives, "test") {
            assert!((draw[..5].iter().sum::<f64>() - 5.0).abs() < 1e-12);
            assert!((draw[5..].iter().sum::<f64>() - 4.0).abs() < 1e-12);
        }
    }

    #[test]
    fn quantiles_of_a_ramp() {
        let mut values: Vec<f64> = (0..=100).rev().map(f64::from).collect();
        assert!((quantile(&mut values, 0.05) - 5.0).abs() < 1e-12);
    }
}

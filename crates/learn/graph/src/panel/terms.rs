//! What the sub-scores that a scorer predicts amount to.

use super::TERMS;

/// Returns the total score that sub-scores 0 to 1 amount to, in the order NC, DAC, DDC, TLC, EP, TTC, LK, HC.
#[must_use]
pub fn total(terms: [f64; TERMS]) -> f64 {
    let [collision, area, direction, light, progress, time, lane, comfort] = terms;
    collision * area * direction * light * (5.0 * time + 5.0 * progress + 2.0 * lane + 2.0 * comfort) / 14.0
}

/// Returns the total that a plan's logits of sub-scores amount to.
#[must_use]
pub fn expected(logits: &[f32]) -> f64 {
    total(std::array::from_fn(|term| sigmoid(logits[term])))
}

/// Returns the probability that a logit stands for.
#[must_use]
pub fn sigmoid(logit: f32) -> f64 {
    1.0 / (1.0 + (-f64::from(logit)).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_total_weighs_sub_scores_as_the_benchmark_does() {
        assert!((total([1.0; TERMS]) - 1.0).abs() < 1e-12);
        assert!(total([1.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]).abs() < 1e-12);
        assert!((total([1.0, 1.0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0]) - 9.0 / 14.0).abs() < 1e-12);
        assert!((expected(&[50.0; TERMS]) - 1.0).abs() < 1e-12);
    }
}

//! The score interval of a share of counted cases (Wilson 1927).

/// Returns the interval of `hits` out of `of` for a normal quantile `z` (1.645 for 90 %); everything where nothing counts.
#[must_use]
pub fn wilson(hits: usize, of: usize, z: f64) -> [f64; 2] {
    if of == 0 {
        return [0.0, 1.0];
    }
    let (n, p) = (of as f64, hits as f64 / of as f64);
    let centre = (p + z * z / (2.0 * n)) / (1.0 + z * z / n);
    let half = z / (1.0 + z * z / n) * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
    [(centre - half).max(0.0), (centre + half).min(1.0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_are_those_of_the_book() {
        let [low, high] = wilson(8, 10, 1.645);
        assert!((low - 0.541).abs() < 0.002 && (high - 0.931).abs() < 0.002, "{low} to {high}");
        assert_eq!(wilson(0, 0, 1.645), [0.0, 1.0]);
    }
}

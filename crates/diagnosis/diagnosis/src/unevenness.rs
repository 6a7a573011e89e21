//! What is uneven about stamps that grow: gaps that straight lines bridge, and scatter of the steps.

/// Usual steps from which on a step is a gap.
const GAP_STEPS: f64 = 2.5;
/// Half of the range of the middle nine tenths of the steps, as a share of the usual one, that is worth a line.
const NOTED_SCATTER: f64 = 0.25;

/// Gaps in stamps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gaps {
    /// How many.
    pub count: usize,
    /// The longest, s.
    pub longest_secs: f64,
    /// Stamp before the first, s.
    pub after_secs: f64,
}

/// Returns the gaps longer than two usual steps and than `least_secs`.
#[must_use]
pub fn gaps(t: &[f64], usual_secs: f64, least_secs: f64) -> Option<Gaps> {
    let least = (GAP_STEPS * usual_secs).max(least_secs);
    let long: Vec<&[f64]> = t.windows(2).filter(|pair| pair[1] - pair[0] > least).collect();
    let longest_secs = long.iter().map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
    Some(Gaps { count: long.len(), longest_secs, after_secs: long.first()?[0] })
}

/// Returns the twentieth and the last but one twentieth of the steps, s, where they scatter much.
#[must_use]
pub fn scatter(t: &[f64], usual_secs: f64) -> Option<[f64; 2]> {
    let mut steps: Vec<f64> = t.windows(2).map(|pair| pair[1] - pair[0]).collect();
    if steps.is_empty() {
        return None;
    }
    let [low, high] = [0.05, 0.95].map(|share| ds_stats::quantile(&mut steps, share));
    (high - low > 2.0 * NOTED_SCATTER * usual_secs).then_some([low, high])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_and_jitter_are_told_and_even_stamps_have_none() {
        let even: Vec<f64> = (0..2000).map(|k| f64::from(k) * 0.005).collect();
        assert_eq!((gaps(&even, 0.005, 0.05), scatter(&even, 0.005)), (None, None));
        let holed: Vec<f64> = even.iter().copied().filter(|t| !(3.0..3.3).contains(t)).collect();
        let found = gaps(&holed, 0.005, 0.05).expect("a gap");
        assert!(found.count == 1 && (found.longest_secs - 0.305).abs() < 1e-9, "{found:?}");
        assert!((found.after_secs - 2.995).abs() < 1e-9 && scatter(&holed, 0.005).is_none(), "{found:?}");
        let jittery: Vec<f64> = even.iter().enumerate().map(|(k, t)| t + 0.002 * (k % 2) as f64).collect();
        let [low, high] = scatter(&jittery, 0.005).expect("scatter");
        assert!((low - 0.003).abs() < 1e-9 && (high - 0.007).abs() < 1e-9, "{low} {high}");
    }
}

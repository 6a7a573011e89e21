//! Paired permutation test by sign flips.
//!
//! If two runs do not differ, each unit's difference is as likely to have the other sign. The p-value is the share
//! of all sign patterns whose mean is at least as far from 0 as the observed one (Fisher 1935; Good 2005, chapter 3):
//! exact for up to 12 units, else of 10,000 drawn patterns with one added above and below (Phipson and Smyth 2010).

use ds_space::Draws;

/// Most units for which every sign pattern is tried.
pub const EXACT_UP_TO: usize = 12;
/// Drawn patterns above that.
pub const PATTERNS: u64 = 10_000;

/// The probability of a difference at least this large if there is none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chance {
    /// The two-sided p-value.
    pub p: f64,
    /// Whether every sign pattern was tried.
    pub exact: bool,
}

/// Returns the two-sided p-value of the mean difference; nothing for no differences. Patterns come from `draws` where
/// there are too many to try.
#[must_use]
pub fn sign_flip(differences: &[f64], draws: &Draws) -> Option<Chance> {
    if differences.is_empty() {
        return None;
    }
    // Sums of the same numbers in other signs may differ in the last bits; they count as equal.
    let slack = 1e-12 * differences.iter().map(|d| d.abs()).sum::<f64>();
    let observed = differences.iter().sum::<f64>().abs() - slack;
    let sum = |flipped: &dyn Fn(usize) -> bool| {
        differences.iter().enumerate().map(|(i, d)| if flipped(i) { -d } else { *d }).sum::<f64>().abs()
    };
    if differences.len() <= EXACT_UP_TO {
        let patterns = 1u32 << differences.len();
        let hits = (0..patterns).filter(|pattern| sum(&|i| pattern >> i & 1 == 1) >= observed).count();
        return Some(Chance { p: hits as f64 / f64::from(patterns), exact: true });
    }
    let words = differences.len().div_ceil(64) as u64;
    let hits = (0..PATTERNS).filter(|pattern| {
        let bits: Vec<u64> = (0..words).map(|word| draws.u64(pattern * words + word)).collect();
        sum(&|i| bits[i / 64] >> (i % 64) & 1 == 1) >= observed
    });
    Some(Chance { p: (1 + hits.count()) as f64 / (1 + PATTERNS) as f64, exact: false })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn draws(seed: u64) -> Draws {
        Draws::from_seed(seed, "permutation test")
    }

    fn check(differences: &[f64], expected: f64) {
        let found = sign_flip(differences, &draws(1)).expect("differences");
        assert!(found.exact && (found.p - expected).abs() < 1e-12, "{differences:?}: {found:?}, not {expected}");
    }

    #[test]
    fn equals_values_worked_out_by_hand() {
        // All of one sign: only the pattern itself and its opposite reach the sum.
        check(&[1.0, 2.0, 3.0], 2.0 / 8.0);
        check(&[0.1; 6], 2.0 / 64.0);
        // Sums of ±1 ±2 ±3: 6, 4, 2, 0 and their opposites, 0 twice; |sum| ≥ 4 in 4 of 8, ≥ 2 in 6 of 8.
        check(&[-1.0, 2.0, 3.0], 4.0 / 8.0);
        check(&[1.0, -2.0, 3.0], 6.0 / 8.0);
        check(&[1.0, 2.0, -3.0], 1.0);
        // A zero doubles the patterns and the hits alike.
        check(&[1.0, 2.0, 3.0, 0.0], 2.0 / 8.0);
        check(&[0.0, 0.0], 1.0);
        check(&[0.1, 0.2, 0.3, -0.6 + 0.6], 2.0 / 8.0);
        assert_eq!(sign_flip(&[], &draws(1)), None);
    }

    #[test]
    fn drawn_patterns_agree_with_all_patterns() {
        // 13 differences of ±1 with 10 ups: |sum| ≥ 7 for k ≤ 3 or k ≥ 10 ups, 2·(1+13+78+286)/8192.
        let differences: Vec<f64> = (0..13).map(|i| if i < 10 { 1.0 } else { -1.0 }).collect();
        let found = sign_flip(&differences, &draws(2)).expect("differences");
        assert!(!found.exact && (found.p - 756.0 / 8192.0).abs() < 0.012, "{found:?}");
        assert!(sign_flip(&[0.3; 100], &draws(3)).expect("differences").p <= 2.0 / 10_001.0);
    }
}

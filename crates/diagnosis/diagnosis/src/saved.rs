//! What the effects save of a metric, in its own unit, with an interval over the drives that it was measured on.

use ds_stats::percentiles;
use serde::{Deserialize, Serialize};

use crate::null;

/// Drives from which on a bootstrap over them has an interval: below, it is too narrow (`ds_stats::bootstrap`).
const LEAST_DRIVES: usize = 5;
/// Share of the draws beyond either end.
const TAIL: f64 = 0.05;

/// What is saved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Saved {
    /// Root mean square with the ordinary mismatch fitted less that with the effects added as well; negative where it grew.
    #[serde(deserialize_with = "null::number")]
    pub value: f64,
    /// 90 % interval for drives still to come; absent where there are too few.
    #[serde(default, deserialize_with = "null::known_pair", skip_serializing_if = "Option::is_none")]
    pub interval90: Option<[f64; 2]>,
    /// Drives that it was measured on.
    pub drives: usize,
    /// Why there is no interval.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
}

impl Saved {
    /// Tells what is saved over some drives: `all` is (ordinary mismatch, effects added) of all data, `drawn` the same of each
    /// resample of the drives; nothing where nothing was added.
    #[must_use]
    pub fn new(all: [f64; 2], drawn: impl Iterator<Item = [f64; 2]>, drives: usize) -> Option<Self> {
        let [nuisance, after] = all;
        if nuisance.to_bits() == after.to_bits() {
            return None;
        }
        let less = |[nuisance, after]: [f64; 2]| nuisance - after;
        let enough = drives >= LEAST_DRIVES;
        let interval90 = enough.then(|| percentiles(drawn.map(less).collect(), TAIL)).flatten();
        let word = if drives == 1 { "drive is" } else { "drives are" };
        let note = (!enough).then(|| format!("{drives} {word} too few for an interval, {LEAST_DRIVES} are needed"));
        Some(Self { value: less(all), interval90, drives, note })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_few_drives_have_no_interval_and_say_so() {
        let drawn = |k: i32| [1.0 + 0.01 * f64::from(k), 0.4];
        let of = |drives: usize| Saved::new([1.0, 0.4], (-10..=10).map(drawn), drives).expect("something was added");
        let many = of(5);
        assert!((many.value - 0.6).abs() < 1e-12 && many.note.is_none(), "{many:?}");
        let [low, high] = many.interval90.expect("five drives");
        assert!((low - 0.51).abs() < 1e-9 && (high - 0.69).abs() < 1e-9, "{low} {high}");
        for (drives, said) in [(4, "4 drives are too few"), (1, "1 drive is too few")] {
            let few = of(drives);
            assert!(few.interval90.is_none() && few.note.is_some_and(|note| note.starts_with(said)), "{drives}");
        }
        assert_eq!(Saved::new([0.7, 0.7], std::iter::empty(), 8), None);
    }
}

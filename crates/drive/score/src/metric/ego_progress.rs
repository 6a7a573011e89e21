//! EP ∈ [0, 1]: progress along the centreline against the best of all proposals that obey the rules.
//!
//! Raw progress: PDM `pdm_scorer.py:476-490`; v2 normalises it by `:223-238`, v1 by NV1 `pdm_scorer.py:156-183`.

use crate::constants::horizon::STEPS;
use crate::constants::navsim::PROGRESS_LEAST_M;
use crate::metric::lane_keeping::Places;

/// Returns the progress of the box's centre over the horizon, in metres, at least 0.
pub(crate) fn raw_m(places: &Places) -> f64 {
    (places.along_m[STEPS] - places.along_m[0]).max(0.0)
}

/// Returns the best progress of proposals, each weighed by the product of its multipliers, in metres.
pub(crate) fn best_m(proposals: impl Iterator<Item = (f64, f64)>) -> f64 {
    proposals.map(|(raw_m, multipliers)| raw_m * multipliers).fold(0.0, f64::max)
}

/// Returns the score of v2: not zeroed by a failed multiplier.
pub(crate) fn score_v2(raw_m: f64, best_m: f64) -> f64 {
    if best_m > PROGRESS_LEAST_M { (raw_m / best_m).clamp(0.0, 1.0) } else { 1.0 }
}

/// Returns the score of v1: weighed by the multipliers.
pub(crate) fn score_v1(raw_m: f64, multipliers: f64, best_m: f64) -> f64 {
    if best_m > PROGRESS_LEAST_M {
        raw_m * multipliers / best_m
    } else if multipliers == 0.0 {
        0.0
    } else {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_table() {
        for (raw_m, multipliers, best_m, v2, v1) in [
            (20.0, 1.0, 40.0, 0.5, 0.5),
            (50.0, 0.0, 40.0, 1.0, 0.0),
            (30.0, 0.5, 40.0, 0.75, 0.375),
            (3.0, 1.0, 5.0, 1.0, 1.0),
            (3.0, 0.0, 5.0, 1.0, 0.0),
        ] {
            assert_eq!(
                (score_v2(raw_m, best_m), score_v1(raw_m, multipliers, best_m)),
                (v2, v1),
                "{raw_m} of {best_m}"
            );
        }
        assert_eq!(best_m([(30.0, 1.0), (50.0, 0.5), (90.0, 0.0)].into_iter()), 30.0);
    }
}

//! The share of an error beyond its floor that a change takes away, with what a bootstrap says of it.
//!
//! One formula, 1 - (after - floor) / (before - floor), bounded on neither side. Where the error before lies less than two
//! standard errors over the floor, in the data at hand or in such as are still to come, there is nothing to take a share of,
//! and the share is unknown.

use crate::quantile::percentiles;

/// Standard errors by which an error must exceed its floor before shares of the excess mean anything.
const RESOLVED: f64 = 2.0;

/// A share with its interval.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Explained {
    /// The share; above 1 where the error falls below the floor, below 0 where it grows.
    pub share: f64,
    /// The range that leaves a twentieth of the resamples on either side.
    pub interval90: [f64; 2],
}

/// Returns 1 - (after - floor) / (before - floor); not finite where before equals the floor.
#[must_use]
pub fn share([before, after, floor]: [f64; 3]) -> f64 {
    1.0 - (after - floor) / (before - floor)
}

/// Returns the share of an error explained with its interval: `all` is (before, after, floor) of all data, `drawn` the
/// same of each resample. Exactly 0 where before and after are the same, unknown where before is not resolved from the
/// floor.
#[must_use]
pub fn explained(all: [f64; 3], drawn: &[[f64; 3]]) -> Option<Explained> {
    explained_elsewhere(all, drawn, drawn)
}

/// Returns the same with an interval for data that are still to come: `elsewhere` is drawn as they may be, while `drawn`
/// says whether there is a gap in the data at hand. Unknown as well where `elsewhere` the gap is not resolved.
#[must_use]
pub fn explained_elsewhere(all: [f64; 3], drawn: &[[f64; 3]], elsewhere: &[[f64; 3]]) -> Option<Explained> {
    let [before, after, floor] = all;
    if before.to_bits() == after.to_bits() && before.is_finite() {
        return Some(Explained { share: 0.0, interval90: [0.0; 2] });
    }
    let gap = before - floor;
    let error = |drawn: &[[f64; 3]]| {
        let squares = drawn.iter().map(|[before, _, floor]| (before - floor - gap).powi(2));
        (squares.sum::<f64>() / drawn.len().max(1) as f64).sqrt()
    };
    // a gap or an error that is not a number is not resolved either; a gap that may be nil elsewhere has no share there
    if !(gap > 0.0 && gap > RESOLVED * error(drawn) && gap > RESOLVED * error(elsewhere) && after.is_finite()) {
        return None;
    }
    let shares: Vec<f64> = elsewhere.iter().copied().map(share).filter(|share| share.is_finite()).collect();
    Some(Explained { share: share(all), interval90: percentiles(shares, 0.05)? })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn around(all: [f64; 3], by: f64) -> Vec<[f64; 3]> {
        (-10..=10).map(|k| [all[0] + by * f64::from(k), all[1], all[2]]).collect()
    }

    #[test]
    fn shares_have_no_bounds() {
        for (errors, expected) in
            [([5.0, 2.0, 1.0], 0.75), ([5.0, 5.5, 1.0], -0.125), ([5.0, 0.5, 1.0], 1.125), ([2.0, 12.0, 1.0], -10.0)]
        {
            let found = explained(errors, &around(errors, 0.01)).expect("a share");
            assert!((found.share - expected).abs() < 1e-12, "{errors:?}: {found:?}");
            assert!(found.interval90[0] <= found.share && found.share <= found.interval90[1], "{found:?}");
        }
    }

    #[test]
    fn a_gap_within_two_standard_errors_has_no_share() {
        let errors = [1.1, 1.0, 1.0];
        assert!(explained(errors, &around(errors, 0.001)).is_some());
        // 21 even steps of 0.1 have a standard deviation of 0.61
        assert_eq!(explained(errors, &around(errors, 0.1)), None);
        assert_eq!(explained([0.9, 0.8, 1.0], &around([0.9, 0.8, 1.0], 0.0)), None);
        assert_eq!(explained([f64::NAN, 0.8, 1.0], &[]), None);
    }

    #[test]
    fn a_gap_that_may_be_nil_elsewhere_has_no_share() {
        let errors = [2.0, 1.2, 1.0];
        let here = around(errors, 0.01);
        let sure = explained_elsewhere(errors, &here, &around(errors, 0.05)).expect("a share");
        assert!(sure.interval90[0] > 0.5 && sure.interval90[1] < 1.0, "{sure:?}");
        // a standard deviation of 0.61, as above
        assert_eq!(explained_elsewhere(errors, &here, &around(errors, 0.1)), None);
    }

    #[test]
    fn what_changes_nothing_explains_nothing() {
        for before in [0.5, 1.0, 5.0] {
            let found = explained([before, before, 1.0], &around([before, before, 1.0], 3.0)).expect("a share");
            assert_eq!((found.share, found.interval90), (0.0, [0.0; 2]));
        }
    }
}

//! `progress`: the ego's distance along the route ÷ the logged expert's over the same ticks, clipped to 0..=1.
//!
//! Not applicable while the expert has moved less than 1 m.

use super::odometer::SHORTEST_M;

/// Returns the score for distances along the route since the first state.
pub(crate) fn score(ego_m: f64, expert_m: f64) -> Option<f64> {
    (expert_m >= SHORTEST_M).then(|| (ego_m / expert_m).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_table() {
        for (ego_m, expert_m, expected) in [
            (20.0, 40.0, Some(0.5)),
            (50.0, 40.0, Some(1.0)),
            (-3.0, 40.0, Some(0.0)),
            (5.0, 0.9, None),
            (0.25, 1.0, Some(0.25)),
            (5.0, -40.0, None),
        ] {
            assert_eq!(score(ego_m, expert_m), expected, "{ego_m} of {expert_m} m");
        }
    }
}

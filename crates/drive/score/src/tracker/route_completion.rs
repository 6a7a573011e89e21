//! `route_completion`: the share of the route that the ego has behind it, from where it started to where the log ends.
//!
//! What is driven after leaving the route by more than 4 m does not count (the closed-loop evaluation ends there).
//! Not applicable if the log covers less than 1 m from there on. An episode shorter than the log ends below 1.

use super::odometer::SHORTEST_M;

/// An ego farther from its route than this has left it, in metres.
pub(crate) const LEFT_AT_M: f64 = 4.0;

/// Returns the score for the ego's distance along the route since the first state and the distance to the log's end.
pub(crate) fn score(ego_m: f64, whole_m: f64) -> Option<f64> {
    (whole_m >= SHORTEST_M).then(|| (ego_m / whole_m).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_table() {
        for (ego_m, whole_m, expected) in
            [(30.0, 120.0, Some(0.25)), (121.0, 120.0, Some(1.0)), (-1.0, 120.0, Some(0.0)), (0.0, 0.0, None)]
        {
            assert_eq!(score(ego_m, whole_m), expected, "{ego_m} of {whole_m} m");
        }
    }
}

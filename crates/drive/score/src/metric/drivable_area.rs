//! DAC ∈ {0, 1}: 0 if a corner is off drivable surface at any step (PDM `pdm_scorer.py:422-429`).

use super::unless;
use crate::ego_area::EgoAreas;
use crate::proposal::Violation;

/// Returns the score and the first step off the road.
pub(crate) fn score(areas: &EgoAreas) -> (f64, Option<Violation>) {
    let first = areas.non_drivable.first().map(Violation::at);
    (unless(first.is_some()), first)
}

//! HC ∈ {0, 1}: comfort over the past and the executed states, joined (PDM `pdm_scorer.py:656-700`).
//!
//! Past states stop at −0.2 s and are followed by state 0 as if 0.1 s apart, a quirk of the reference. Without a past
//! HC is 1.

use crate::comfort::{ComfortFilters, Within};
use crate::motion::{Executed, VehicleState};
use crate::proposal::Memory;

/// Returns which terms hold over past and executed states; `displacement_m` leads from the rear axle to the centre.
pub(crate) fn within(
    filters: &ComfortFilters,
    past: &[VehicleState],
    states: &Executed,
    displacement_m: f64,
    memory: &mut Memory,
) -> Within {
    memory.history.clear();
    memory.history.extend_from_slice(past);
    memory.history.extend_from_slice(states);
    filters.within(&memory.history, displacement_m, &mut memory.comfort)
}

/// Returns the score of the terms.
pub(crate) fn score(within: Option<&Within>) -> f64 {
    super::unless(within.is_some_and(|within| within.contains(&false)))
}

//! C ∈ {0, 1} of v1: comfort of the executed states alone, at the rear axle, windows as long as the series.

use crate::comfort::{ComfortFilters, Within};
use crate::motion::Executed;
use crate::proposal::Memory;

/// Returns the score and its terms.
pub(crate) fn score(filters: &ComfortFilters, states: &Executed, memory: &mut Memory) -> (f64, Within) {
    let within = filters.within(states, 0.0, &mut memory.comfort);
    (super::unless(within.contains(&false)), within)
}

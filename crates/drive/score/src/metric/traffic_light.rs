//! TLC ∈ {0, 1}: 0 if the ego's box touches an on-route connector that shows red (PDM `pdm_scorer.py:582-613`).

use super::unless;
use crate::proposal::{Footsteps, Violation};
use crate::scene::AreaIndex;

/// Returns the score and the first step on a red connector; `red` holds polygon ids per step.
pub(crate) fn score(index: &AreaIndex, red: &[Vec<u32>], steps: &Footsteps) -> (f64, Option<Violation>) {
    let first = steps
        .boxes
        .iter()
        .zip(red)
        .position(|(ego, red)| red.iter().any(|id| index.polygons[*id as usize].touches(ego)));
    (unless(first.is_some()), first.map(Violation::at))
}

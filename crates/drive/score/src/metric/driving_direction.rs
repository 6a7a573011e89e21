//! DDC ∈ {0, ½, 1}: how far the ego drove off its route's lanes within 1 s (PDM `pdm_scorer.py:431-474`).

use crate::constants::horizon::STATES;
use crate::constants::navsim::{DIRECTION_COMPLIANT_M, DIRECTION_PARTLY, DIRECTION_STEPS, DIRECTION_VIOLATED_M};
use crate::ego_area::EgoAreas;
use crate::proposal::{Footsteps, Violation};

/// Whether driving in a junction may be oncoming.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Junctions {
    /// Never (v2).
    Exempt,
    /// As anywhere (v1).
    Counted,
}

/// Returns the score and the first step at which it is not compliant.
pub(crate) fn score(steps: &Footsteps, areas: &EgoAreas, junctions: Junctions) -> (f64, Option<Violation>) {
    let travel_m: [f64; STATES] = std::array::from_fn(|step| {
        let exempt = junctions == Junctions::Exempt && areas.centre_in_intersection.at(step);
        let counts = step > 0 && areas.oncoming.at(step) && !exempt;
        if counts { (steps.boxes[step].centre - steps.boxes[step - 1].centre).length() } else { 0.0 }
    });
    let mut most_m = 0.0f64;
    let mut first = None;
    for step in 0..STATES {
        let sum_m: f64 = travel_m[step.saturating_sub(DIRECTION_STEPS)..=step].iter().sum();
        if first.is_none() && sum_m >= DIRECTION_COMPLIANT_M {
            first = Some(Violation::at(step));
        }
        most_m = most_m.max(sum_m);
    }
    (value(most_m), first)
}

/// Returns the score of the longest wrong-way travel within 1 s, in metres.
pub(crate) fn value(most_m: f64) -> f64 {
    if most_m < DIRECTION_COMPLIANT_M {
        1.0
    } else if most_m < DIRECTION_VIOLATED_M {
        DIRECTION_PARTLY
    } else {
        0.0
    }
}

//! NC ∈ {0, ½, 1}: 0 after an at-fault collision with an agent, ½ with a static object (PDM `pdm_scorer.py:363-420`).
//!
//! An agent whose first touch is not the ego's fault is ignored from then on, so that only first touches matter.

use super::unless;
use crate::collision_type::CollisionType;
use crate::constants::navsim::STATIC_COLLISION;
use crate::ego_area::EgoAreas;
use crate::proposal::{Footsteps, Violation};
use crate::scene::{ObjectClass, TrafficAgent};

/// Returns the score and the first at-fault collision.
pub(crate) fn score<'a>(
    agents: impl Iterator<Item = &'a TrafficAgent>,
    steps: &Footsteps,
    areas: &EgoAreas,
) -> (f64, Option<Violation>) {
    let mut value = 1.0f64;
    let mut first: Option<Violation> = None;
    for agent in agents {
        let touch = steps.boxes.iter().zip(&agent.boxes).enumerate().find_map(|(step, (ego, other))| {
            other.as_ref().filter(|other| ego.touches(other)).map(|other| (step, ego, other))
        });
        let Some((step, ego, other)) = touch else { continue };
        let kind = CollisionType::of(ego, steps.axles[step], steps.speeds_mps[step], other, agent.stopped);
        if kind.at_fault(areas.astray(step)) {
            value = value.min(match agent.class {
                ObjectClass::Agent => unless(true),
                ObjectClass::Static => STATIC_COLLISION,
            });
            first = Violation::earlier(first, step, agent.id);
        }
    }
    (value, first)
}

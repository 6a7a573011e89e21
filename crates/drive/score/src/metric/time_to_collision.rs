//! TTC ∈ {0, 1}: 0 if the ego, moved on at its speed by up to 0.9 s, meets what is ahead (PDM `pdm_scorer.py:492-580`).
//!
//! The agents are those of the later step. A touch that does not count makes the agent ignored from then on, so that
//! only the first touch of each agent matters (order: step, then look-ahead).

use super::unless;
use crate::collision_type::{is_ahead, is_behind};
use crate::constants::horizon::DT_S;
use crate::constants::navsim::{TTC_AHEAD, TTC_STOPPED_MPS};
use crate::ego_area::EgoAreas;
use crate::proposal::{Footsteps, Violation};
use crate::scene::{AreaIndex, TrafficAgent};
use ds_space::plane::OrientedBox;

/// Returns the score over the first `count` steps and the first violation.
pub(crate) fn score<'a>(
    agents: impl Iterator<Item = &'a TrafficAgent>,
    index: &AreaIndex,
    steps: &Footsteps,
    areas: &EgoAreas,
    count: usize,
) -> (f64, Option<Violation>) {
    let mut first: Option<Violation> = None;
    for agent in agents {
        let Some((step, other)) = first_touch(agent, steps, count) else { continue };
        let forward = steps.boxes[step].forward;
        let offset = other.centre - steps.axles[step];
        let astray = || areas.astray(step) || index.in_intersection(steps.axles[step]);
        let counts = is_ahead(forward, offset) || (!is_behind(forward, offset) && astray());
        if counts {
            first = Violation::earlier(first, step, agent.id);
        }
    }
    (unless(first.is_some()), first)
}

fn first_touch<'a>(agent: &'a TrafficAgent, steps: &Footsteps, count: usize) -> Option<(usize, &'a OrientedBox)> {
    for step in 0..count {
        let speed_mps = steps.speeds_mps[step];
        if speed_mps < TTC_STOPPED_MPS {
            continue;
        }
        let ego = &steps.boxes[step];
        for ahead in TTC_AHEAD {
            let Some(other) = agent.boxes.get(step + ahead).and_then(Option::as_ref) else { continue };
            if ego.moved(ego.forward * (speed_mps * (ahead as f64 * DT_S))).touches(other) {
                return Some((step, other));
            }
        }
    }
    None
}

//! LK ∈ {0, 1}: 0 after 2 s on end more than 0.5 m from the centreline (PDM `pdm_scorer.py:615-654`).
//!
//! Steps inside a junction are skipped: they neither count nor reset.

use super::unless;
use crate::constants::horizon::STATES;
use crate::constants::navsim::{LANE_OFFSET_M, LANE_STEPS};
use crate::ego_area::EgoAreas;
use crate::proposal::{Footsteps, Violation};
use ds_space::plane::Line;

/// Where the box's centre is relative to the centreline at each step, in metres.
#[derive(Debug, Clone)]
pub(crate) struct Places {
    pub(crate) along_m: [f64; STATES],
    pub(crate) distance_m: [f64; STATES],
}

impl Places {
    pub(crate) fn new(centreline: &Line, steps: &Footsteps) -> Self {
        let mut places = Self { along_m: [0.0; STATES], distance_m: [0.0; STATES] };
        let mut hint = 0;
        for step in 0..STATES {
            let nearest = centreline.nearest_from(steps.boxes[step].centre, hint);
            hint = nearest.segment;
            places.along_m[step] = nearest.along_m;
            places.distance_m[step] = nearest.distance_squared.sqrt();
        }
        places
    }
}

/// Returns the score and the step at which it failed.
pub(crate) fn score(places: &Places, areas: &EgoAreas) -> (f64, Option<Violation>) {
    let mut beside = 0;
    for step in (0..STATES).filter(|step| !areas.centre_in_intersection.at(*step)) {
        beside = if places.distance_m[step] > LANE_OFFSET_M { beside + 1 } else { 0 };
        if beside >= LANE_STEPS {
            return (unless(true), Some(Violation::at(step)));
        }
    }
    (unless(false), None)
}

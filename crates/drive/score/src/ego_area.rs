//! In which areas the ego is at each step: multiple lanes, non-drivable, oncoming (`scoring.md` §3).
//!
//! Being inside is strict. Oncoming means that the box's centre lies in no lane or connector of the route, so that
//! off-road and off-route lanes count too.

use crate::constants::horizon::STATES;
use crate::lane_marks::LaneMarks;
use crate::proposal::Footsteps;
use crate::scene::{AreaIndex, AreaKind};
use ds_space::plane::OrientedBox;

/// One flag per step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StepFlags(u64);

impl StepFlags {
    /// Says whether the flag is set at a step.
    #[must_use]
    pub fn at(self, step: usize) -> bool {
        self.0 >> step & 1 == 1
    }

    /// Returns the first step with the flag.
    #[must_use]
    pub fn first(self) -> Option<usize> {
        (self.0 != 0).then(|| self.0.trailing_zeros() as usize)
    }

    /// Returns the flags as characters `0` and `1`, one per scored state.
    #[must_use]
    pub fn text(self) -> String {
        (0..STATES).map(|step| if self.at(step) { '1' } else { '0' }).collect()
    }

    pub(crate) fn set(&mut self, step: usize, flag: bool) {
        self.0 |= u64::from(flag) << step;
    }
}

/// The areas of an executed plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EgoAreas {
    /// More than one lane holds a corner, and none holds all four.
    pub multiple_lanes: StepFlags,
    /// A corner lies on no drivable surface.
    pub non_drivable: StepFlags,
    /// The centre lies in no lane of the route.
    pub oncoming: StepFlags,
    /// The centre lies in a junction.
    pub centre_in_intersection: StepFlags,
}

impl EgoAreas {
    /// Says whether the ego is in multiple lanes or non-drivable at a step.
    pub(crate) fn astray(&self, step: usize) -> bool {
        self.multiple_lanes.at(step) || self.non_drivable.at(step)
    }

    pub(crate) fn new(index: &AreaIndex, steps: &Footsteps, marks: &mut LaneMarks) -> Self {
        let mut areas = Self::default();
        for (step, footprint) in steps.boxes.iter().enumerate() {
            let here = BoxAreas::new(index, footprint, marks);
            areas.multiple_lanes.set(step, here.multiple_lanes);
            areas.non_drivable.set(step, here.non_drivable);
            areas.oncoming.set(step, here.oncoming);
            areas.centre_in_intersection.set(step, here.centre_in_intersection);
        }
        areas
    }
}

/// The areas of one box, as in [`EgoAreas`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct BoxAreas {
    pub(crate) multiple_lanes: bool,
    pub(crate) non_drivable: bool,
    pub(crate) oncoming: bool,
    pub(crate) centre_in_intersection: bool,
}

impl BoxAreas {
    pub(crate) fn new(index: &AreaIndex, footprint: &OrientedBox, marks: &mut LaneMarks) -> Self {
        marks.clear(index.polygons.len());
        let mut all_drivable = true;
        for (number, corner) in footprint.corners().into_iter().enumerate() {
            let mut drivable = false;
            for id in index.near(corner) {
                let id = *id as usize;
                let lane = index.kinds[id].is_lane();
                if (lane || !drivable) && index.polygons[id].holds(corner) {
                    if lane {
                        marks.mark(id, number);
                    } else {
                        drivable = true;
                    }
                }
            }
            all_drivable &= drivable;
        }
        let centre = footprint.centre;
        let (mut on_route, mut in_intersection) = (false, false);
        for id in index.near(centre) {
            let id = *id as usize;
            let intersection = index.kinds[id] == AreaKind::Intersection;
            let asked = (index.on_route[id] && !on_route) || (intersection && !in_intersection);
            if asked && index.polygons[id].holds(centre) {
                on_route |= index.on_route[id];
                in_intersection |= intersection;
            }
        }
        Self {
            multiple_lanes: marks.in_multiple(),
            non_drivable: !all_drivable,
            oncoming: !on_route,
            centre_in_intersection: in_intersection,
        }
    }
}

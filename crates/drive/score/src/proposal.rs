//! An executed plan as the metrics look at it: boxes, speeds and areas per step, and memory that is reused.

use ds_space::DVec2;
use ds_space::plane::{Bounds, OrientedBox};

use crate::comfort::ComfortSeries;
use crate::constants::horizon::{DT_S, STATES};
use crate::constants::navsim::TTC_AHEAD;
use crate::footprint::Footprint;
use crate::lane_marks::LaneMarks;
use crate::motion::{Executed, VehicleState};
use crate::scene::{Traffic, TrafficAgent};

/// Boxes, rear axles and speeds of the ego per step. World frame, SI units.
#[derive(Debug, Clone)]
pub(crate) struct Footsteps {
    pub(crate) boxes: [OrientedBox; STATES],
    pub(crate) axles: [DVec2; STATES],
    pub(crate) speeds_mps: [f64; STATES],
    /// Around everything that is tested against agents, the look-ahead included.
    pub(crate) reach: Bounds,
}

impl Footsteps {
    pub(crate) fn new(states: &Executed, footprint: &Footprint) -> Self {
        let boxes = std::array::from_fn(|step| footprint.at(&states[step].pose()));
        let speeds_mps: [f64; STATES] = std::array::from_fn(|step| states[step].speed_mps());
        let farthest_s = TTC_AHEAD[TTC_AHEAD.len() - 1] as f64 * DT_S;
        let mut reach = Bounds::EMPTY;
        for (one, speed_mps) in boxes.iter().zip(speeds_mps) {
            let here = OrientedBox::bounds(one);
            let ahead = one.moved(one.forward * speed_mps * farthest_s).bounds();
            reach = reach.union(&here).union(&ahead);
        }
        Self { boxes, axles: std::array::from_fn(|step| states[step].position()), speeds_mps, reach }
    }
}

/// Memory that scoring reuses from proposal to proposal.
#[derive(Debug, Clone, Default)]
pub(crate) struct Memory {
    /// Agents that the proposal may meet: which traffic, and position in it.
    near: Vec<(u32, u32)>,
    pub(crate) lanes: LaneMarks,
    pub(crate) comfort: ComfortSeries,
    pub(crate) history: Vec<VehicleState>,
}

impl Memory {
    /// Notes the agents whose boxes come near the ego's.
    pub(crate) fn find_near(&mut self, traffics: &[&Traffic], steps: &Footsteps) {
        self.near.clear();
        for (which, traffic) in (0u32..).zip(traffics) {
            let near = (0u32..).zip(traffic.agents()).filter(|(_, agent)| agent.bounds.overlaps(&steps.reach));
            self.near.extend(near.map(|(position, _)| (which, position)));
        }
    }

    /// Returns the agents noted last.
    pub(crate) fn near<'a>(&'a self, traffics: &'a [&'a Traffic]) -> impl Iterator<Item = &'a TrafficAgent> {
        self.near.iter().map(|(which, position)| &traffics[*which as usize].agents()[*position as usize])
    }
}

/// A violation: when, and by which object where there is one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Violation {
    /// The step, 0 being now.
    pub step: usize,
    /// The object, if one is involved.
    pub object: Option<u32>,
}

impl Violation {
    /// Makes a violation without an object.
    pub(crate) fn at(step: usize) -> Self {
        Self { step, object: None }
    }

    /// Returns the earlier of a violation and another; of two at one step the one with the lower id.
    pub(crate) fn earlier(first: Option<Self>, step: usize, object: u32) -> Option<Self> {
        match first {
            Some(first) if (first.step, first.object) <= (step, Some(object)) => Some(first),
            _ => Some(Self { step, object: Some(object) }),
        }
    }
}

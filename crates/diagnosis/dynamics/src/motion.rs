//! Where the motion of a window comes from: the built-in car, or a simulator of somebody else.
//!
//! Command paths, actuators, sensors and clocks lie outside: what is moved here is a vehicle on its road, by the steering
//! angle of its wheels and by a force over nominal mass. SI units, x forward, y left.

use ds_effect::{Plant, Port};
use ds_vehicle::Saturation;

use crate::ego::{Actuated, Instant, Start, rollout};

/// One window of a drive to be driven.
#[derive(Debug, Clone, Copy)]
pub struct Window {
    /// Drive of the case.
    pub drive: usize,
    /// Sample of the anchor.
    pub sample: usize,
    /// Where it starts and how long it lasts.
    pub start: Start,
}

/// What moves a car through windows.
pub trait Motion: Send + Sync {
    /// Returns the instants of each window, one every [`crate::ego::ROLL_SECS`] from the start of its warm-up, poses
    /// relative to the anchor; not a number throughout where the simulator did not answer.
    fn roll(&self, windows: &[Window], actuated: &Actuated, plant: &Plant) -> Vec<Vec<Instant>>;

    /// Returns the same for what is reported: a motion that else is put together of runs of other cars is run for this one,
    /// or is not a number.
    fn measure(&self, windows: &[Window], actuated: &Actuated, plant: &Plant) -> Vec<Vec<Instant>> {
        self.roll(windows, actuated, plant)
    }

    /// Returns how many windows of a drive can be measured.
    fn measurable(&self) -> usize {
        usize::MAX
    }
}

/// Tells whether what a law adds at a port is added outside the car that a motion moves: to a reading, or to followers.
#[must_use]
pub fn is_outside(port: Port) -> bool {
    matches!(port, Port::Sensor(_) | Port::Follower)
}

/// A simulator of somebody else in the place of the built-in car.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StandIn {
    /// What it says of itself: baselines that were learned with one of another kind do not speak of it.
    pub kind: String,
    /// Effects on vehicle and road that it cannot have.
    pub lacks: Vec<String>,
    /// Ports inside its car at which it can be given a law.
    pub takes: Vec<Port>,
}

/// Tells whether a law can be put in at a port of the built-in car, or of the simulator that stands in for it.
#[must_use]
pub fn takes(stand_in: Option<&StandIn>, port: Port) -> bool {
    is_outside(port) || stand_in.is_none_or(|stand_in| stand_in.takes.contains(&port))
}

/// The built-in car.
#[derive(Debug, Clone, Copy, Default)]
pub struct BuiltIn;

impl Motion for BuiltIn {
    fn roll(&self, windows: &[Window], actuated: &Actuated, plant: &Plant) -> Vec<Vec<Instant>> {
        let saturation = Saturation::new(plant.vehicle.tyre_knee);
        windows.iter().map(|window| rollout(&window.start, actuated, plant, &saturation)).collect()
    }
}

//! `drive_split`: Front axle's share of the drive force, which takes its part of the friction; never accused, cars differ.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "drive_split",
    insertion: Insertion::Vehicle,
    parameters: &[Parameter::linear("share", "1", (-0.5, 0.5)).usual(0.0, 0.3)],
    channels: &[Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::YawRate, Channel::Ay],
    suspect: false,
    apply: |values, plant| {
        if let Some(circle) = &mut plant.vehicle.friction_circle {
            circle.front_drive = (circle.front_drive + values[0]).clamp(0.0, 1.0);
        }
    },
};

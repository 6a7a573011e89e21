//! `grade`: Constant slope along the path: felt in the speed, not by the accelerometer.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "grade",
    insertion: Insertion::Road,
    parameters: &[Parameter::linear("slope", "rad", (-0.08, 0.08)).usual(0.0, 0.0014)],
    channels: &[Channel::Speed, Channel::WheelSpeed, Channel::Dx],
    suspect: true,
    apply: |values, plant| {
        plant.road.grade_rad += values[0];
    },
};

//! `lever_arm`: Pose reported for a point ahead of the centre of gravity.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "lever_arm",
    insertion: Insertion::Sensor,
    parameters: &[Parameter::linear("arm", "m", (-3.0, 3.0)).usual(0.0, 0.05).of_size()],
    channels: &[Channel::Dx, Channel::Dy],
    suspect: true,
    apply: |values, plant| {
        plant.sensors.lever_arm_m += values[0];
    },
};

//! `imu_misalignment`: Accelerometers mounted turned about the vertical axis: braking leaks into the left axis.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "imu_misalignment",
    insertion: Insertion::Sensor,
    parameters: &[Parameter::linear("angle", "rad", (-0.1, 0.1)).usual(0.0, 0.004)],
    channels: &[Channel::Ax, Channel::Ay],
    suspect: true,
    apply: |values, plant| {
        plant.sensors.misalignment_rad += values[0];
    },
};

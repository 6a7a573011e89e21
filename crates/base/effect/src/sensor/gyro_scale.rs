//! `gyro_scale`: Scale error of the gyro.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "gyro_scale",
    insertion: Insertion::Sensor,
    parameters: &[Parameter::linear("error", "1", (-0.1, 0.1)).usual(0.0, 0.004)],
    channels: &[Channel::YawRate],
    suspect: true,
    apply: |values, plant| {
        plant.sensors.gyro_factor += values[0];
    },
};

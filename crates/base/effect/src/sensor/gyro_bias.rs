//! `gyro_bias`: Zero error of the gyro; does not turn the pose.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "gyro_bias",
    insertion: Insertion::Sensor,
    parameters: &[Parameter::linear("bias", "rad/s", (-0.03, 0.03)).usual(0.0, 0.0008)],
    channels: &[Channel::YawRate],
    suspect: true,
    apply: |values, plant| {
        plant.sensors.gyro_bias_rad_s += values[0];
    },
};

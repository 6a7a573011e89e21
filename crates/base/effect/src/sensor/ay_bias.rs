//! `ay_bias`: Zero error of the left accelerometer.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "ay_bias",
    insertion: Insertion::Sensor,
    parameters: &[Parameter::linear("bias", "m/s^2", (-0.4, 0.4)).usual(0.0, 0.03)],
    channels: &[Channel::Ay],
    suspect: true,
    apply: |values, plant| {
        plant.sensors.ay_bias_mps2 += values[0];
    },
};

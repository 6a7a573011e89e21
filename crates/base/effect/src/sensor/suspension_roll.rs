//! `suspension_roll`: Body roll that tilts the left accelerometer in curves; passenger cars have 3 to 4 percent.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "suspension_roll",
    insertion: Insertion::Sensor,
    parameters: &[Parameter::linear("gain", "1", (0.0, 0.15)).usual(0.035, 0.02)],
    channels: &[Channel::Ay],
    suspect: true,
    apply: |values, plant| {
        plant.sensors.roll_factor += values[0];
    },
};

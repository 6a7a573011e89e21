//! `load_transfer`: Axle loads, and with them cornering stiffness and side force limit, shifted by acceleration and braking; never accused.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "load_transfer",
    insertion: Insertion::Vehicle,
    parameters: &[Parameter::linear("height", "m", (0.0, 1.5)).usual(0.34, 0.10).of_size()],
    channels: &[Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::YawRate, Channel::Ay],
    suspect: false,
    apply: |values, plant| {
        plant.vehicle.load_height_m += values[0];
    },
};

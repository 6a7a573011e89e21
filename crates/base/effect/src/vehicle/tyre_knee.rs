//! `tyre_knee`: Sharpness of the passage from linear to saturated side force; never accused, tyres differ.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "tyre_knee",
    insertion: Insertion::Vehicle,
    parameters: &[Parameter::linear("sharpness", "1", (-2.0, 4.0)).usual(-0.5, 0.5)],
    channels: &[Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::YawRate, Channel::Ay],
    suspect: false,
    apply: |values, plant| {
        plant.vehicle.tyre_knee += values[0];
    },
};

//! `tyre_relaxation`: Distance over which a tyre builds up side force; real tyres have about a quarter of a metre.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "tyre_relaxation",
    insertion: Insertion::Vehicle,
    parameters: &[Parameter::linear("length", "m", (0.05, 1.2)).usual(0.25, 0.1).of_size()],
    channels: &[Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::YawRate, Channel::Ay],
    suspect: true,
    apply: |values, plant| {
        plant.vehicle.relaxation_m += values[0];
    },
};

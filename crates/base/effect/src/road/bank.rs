//! `bank`: Constant slope across the road, left side higher.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "bank",
    insertion: Insertion::Road,
    parameters: &[Parameter::linear("slope", "rad", (-0.08, 0.08)).usual(0.0, 0.0022)],
    channels: &[Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::YawRate, Channel::Ay],
    suspect: true,
    apply: |values, plant| {
        plant.road.bank_rad += values[0];
    },
};

//! `roll_add`: Added rolling resistance coefficient.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "roll_add",
    insertion: Insertion::Vehicle,
    parameters: &[Parameter::linear("coefficient", "1", (0.0, 0.02)).usual(0.0, 0.0008)],
    channels: &[Channel::Speed, Channel::Ax, Channel::WheelSpeed, Channel::Dx],
    suspect: true,
    apply: |values, plant| {
        plant.vehicle.rolling_mps2 += 9.81 * values[0];
    },
};

//! `front_grip`: Factor on the cornering stiffness of the front axle.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "front_grip",
    insertion: Insertion::Vehicle,
    parameters: &[Parameter::factor("factor", (-0.5, 0.5)).usual(0.0, 0.03)],
    channels: &[Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::YawRate, Channel::Ay],
    suspect: true,
    apply: |values, plant| {
        plant.vehicle.front_stiffness_n *= values[0];
    },
};

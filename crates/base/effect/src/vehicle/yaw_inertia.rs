//! `yaw_inertia`: Factor on the inertia about the vertical axis.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "yaw_inertia",
    insertion: Insertion::Vehicle,
    parameters: &[Parameter::factor("factor", (-0.4, 0.4)).usual(0.0, 0.05)],
    channels: &[Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::YawRate, Channel::Ay],
    suspect: true,
    apply: |values, plant| {
        plant.vehicle.yaw_inertia_kg_m2 *= values[0];
    },
};

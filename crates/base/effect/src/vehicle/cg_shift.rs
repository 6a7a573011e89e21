//! `cg_shift`: Centre of gravity moved rearwards along the wheelbase.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "cg_shift",
    insertion: Insertion::Vehicle,
    parameters: &[Parameter::linear("shift", "m", (-0.3, 0.3)).usual(0.0, 0.018).of_size()],
    channels: &[Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::YawRate, Channel::Ay],
    suspect: true,
    apply: |values, plant| {
        plant.vehicle.front_arm_m += values[0];
        plant.vehicle.rear_arm_m -= values[0];
    },
};

//! `tr_accel`: Factor on the greatest acceleration of following drivers.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "tr_accel",
    insertion: Insertion::Agent,
    parameters: &[Parameter::factor("factor", (-0.693, 0.47)).usual(0.0, 0.03)],
    channels: &[Channel::FollowerSpeed, Channel::FollowerGap],
    suspect: true,
    apply: |values, plant| {
        plant.follower.max_accel_mps2 *= values[0];
    },
};

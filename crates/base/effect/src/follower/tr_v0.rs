//! `tr_v0`: Factor on the desired speed of following drivers.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "tr_v0",
    insertion: Insertion::Agent,
    parameters: &[Parameter::factor("factor", (-0.511, 0.262)).usual(0.0, 0.012)],
    channels: &[Channel::FollowerSpeed, Channel::FollowerGap],
    suspect: true,
    apply: |values, plant| {
        plant.follower.desired_speed_factor *= values[0];
    },
};

//! `tr_headway`: Factor on the time headway of following drivers.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "tr_headway",
    insertion: Insertion::Agent,
    parameters: &[Parameter::factor("factor", (-0.693, 0.693)).usual(0.0, 0.02)],
    channels: &[Channel::FollowerSpeed, Channel::FollowerGap],
    suspect: true,
    apply: |values, plant| {
        plant.follower.headway_secs *= values[0];
    },
};

//! `tr_min_gap`: Gap at rest of following drivers beyond the nominal one.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "tr_min_gap",
    insertion: Insertion::Agent,
    parameters: &[Parameter::linear("gap", "m", (-1.5, 4.0)).usual(0.0, 0.05)],
    channels: &[Channel::FollowerSpeed, Channel::FollowerGap],
    suspect: true,
    apply: |values, plant| {
        plant.follower.min_gap_m += values[0];
    },
};

//! `tr_lag`: First-order lag of the drive of following vehicles; never accused, every vehicle has some.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "tr_lag",
    insertion: Insertion::Agent,
    parameters: &[Parameter::linear("time_constant", "s", (0.0, 0.4)).usual(0.13, 0.02)],
    channels: &[Channel::FollowerSpeed, Channel::FollowerGap],
    suspect: false,
    apply: |values, plant| {
        plant.follower.lag_secs += values[0];
    },
};

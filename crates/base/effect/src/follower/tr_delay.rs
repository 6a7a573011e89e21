//! `tr_delay`: Reaction time of following drivers.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "tr_delay",
    insertion: Insertion::Agent,
    parameters: &[Parameter::linear("delay", "s", (0.0, 1.2)).usual(0.0, 0.025)],
    channels: &[Channel::FollowerSpeed, Channel::FollowerGap],
    suspect: true,
    apply: |values, plant| {
        plant.follower.delay_secs += values[0];
    },
};

//! `non_yielding`: Share of drivers who do not yield where others have the right of way.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "non_yielding",
    insertion: Insertion::Agent,
    parameters: &[Parameter::linear("probability", "1", (0.0, 1.0))],
    channels: &[Channel::FollowerSpeed, Channel::AgentDecision],
    suspect: true,
    apply: |values, plant| {
        if values[0] != 0.0 {
            plant.agents.yields = true;
            plant.agents.non_yielding = values[0];
        }
    },
};

//! `log_replay_not_reactive`: Others keep to their log whatever the ego vehicle does (a switch).
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "log_replay_not_reactive",
    insertion: Insertion::Agent,
    parameters: &[Parameter { slab: (1.0, 1.0), ..Parameter::threshold("on", "1", (0.0, 1.0)) }],
    channels: &[Channel::FollowerSpeed, Channel::FollowerGap, Channel::AgentDecision],
    suspect: true,
    apply: |values, plant| {
        if values[0] > 0.5 {
            plant.agents.reactive = false;
        }
    },
};

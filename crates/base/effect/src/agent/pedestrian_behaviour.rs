//! `pedestrian_behaviour`: How people on foot walk: factor on their speed, time gap before a vehicle that they accept beyond the usual.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "pedestrian_behaviour",
    insertion: Insertion::Agent,
    parameters: &[Parameter::factor("speed", (-0.5, 0.5)).usual(0.0, 0.03), Parameter::linear("gap", "s", (-2.0, 4.0))],
    channels: &[Channel::FollowerSpeed, Channel::AgentDecision],
    suspect: true,
    apply: |values, plant| {
        if values != [1.0, 0.0] {
            plant.agents.walks = true;
            plant.agents.walking_factor *= values[0];
            plant.agents.walking_gap_secs += values[1];
        }
    },
};

//! `missing_crosswalk`: People cross by right where the map has no crosswalk, and vehicles let them (a switch).
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "missing_crosswalk",
    insertion: Insertion::Map,
    parameters: &[Parameter { slab: (1.0, 1.0), ..Parameter::threshold("on", "1", (0.0, 1.0)) }],
    channels: &[Channel::FollowerSpeed, Channel::AgentDecision],
    suspect: true,
    apply: |values, plant| {
        if values[0] > 0.5 {
            plant.agents.yields = true;
            plant.chart.crosswalk_missing = true;
        }
    },
};

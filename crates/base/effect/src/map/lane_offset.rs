//! `lane_offset`: Lanes lie to the left of where the map says; whoever drives in them shows it.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "lane_offset",
    insertion: Insertion::Map,
    parameters: &[Parameter::linear("offset", "m", (-1.5, 1.5)).usual(0.0, 0.05)],
    channels: &[Channel::AgentLateral],
    suspect: true,
    apply: |values, plant| {
        plant.chart.lane_offset_m += values[0];
    },
};

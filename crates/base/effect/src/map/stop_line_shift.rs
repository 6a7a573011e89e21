//! `stop_line_shift`: Stop lines lie farther along the road than the map says.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "stop_line_shift",
    insertion: Insertion::Map,
    parameters: &[Parameter::linear("shift", "m", (-6.0, 6.0)).usual(0.0, 0.2)],
    channels: &[Channel::FollowerSpeed, Channel::AgentDecision],
    suspect: true,
    apply: |values, plant| {
        plant.chart.stop_line_shift_m += values[0];
    },
};

//! `missing_lane`: The road has a lane to the right that the map lacks, and half of those in the last mapped lane use it (a switch).
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "missing_lane",
    insertion: Insertion::Map,
    parameters: &[Parameter { slab: (1.0, 1.0), ..Parameter::threshold("on", "1", (0.0, 1.0)) }],
    channels: &[Channel::AgentLateral],
    suspect: true,
    apply: |values, plant| {
        plant.chart.lane_missing |= values[0] > 0.5;
    },
};

//! `obs_latency`: Age of the observation a policy acts on; shows in stamps of messages, not in a log of commands.
//! The neutral value leaves the simulator untouched.

use crate::{Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "obs_latency",
    insertion: Insertion::Clock,
    parameters: &[Parameter::linear("latency", "s", (0.0, 0.5))],
    channels: &[],
    suspect: true,
    apply: |values, plant| {
        plant.clock.observation_latency_secs += values[0];
    },
};

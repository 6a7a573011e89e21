//! `encoder_latency`: Age of steering position samples; never accused, every bus has some.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "encoder_latency",
    insertion: Insertion::Clock,
    parameters: &[Parameter::linear("latency", "s", (0.0, 0.1)).usual(0.008, 0.006)],
    channels: &[Channel::SteerMeas],
    suspect: false,
    apply: |values, plant| {
        plant.clock.encoder_latency_secs += values[0];
    },
};

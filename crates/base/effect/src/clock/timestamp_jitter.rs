//! `timestamp_jitter`: Scatter of the sampling instants: noise that grows with the rate of change.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "timestamp_jitter",
    insertion: Insertion::Clock,
    parameters: &[Parameter::linear("rms", "s", (0.0, 0.03)).usual(0.001, 0.001)],
    channels: &[Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::Speed, Channel::YawRate, Channel::Ax, Channel::Ay],
    suspect: true,
    apply: |values, plant| {
        plant.clock.jitter_secs += values[0];
    },
};

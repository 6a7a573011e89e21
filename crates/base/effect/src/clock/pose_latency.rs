//! `pose_latency`: Age of position, heading and speed samples against commands and inertial sensors.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "pose_latency",
    insertion: Insertion::Clock,
    parameters: &[Parameter::linear("latency", "s", (0.0, 0.4)).usual(0.008, 0.007)],
    channels: &[Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::Speed],
    suspect: true,
    apply: |values, plant| {
        plant.clock.pose_latency_secs += values[0];
    },
};

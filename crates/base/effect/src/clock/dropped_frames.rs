//! `dropped_frames`: Share of samples that repeat the one before.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "dropped_frames",
    insertion: Insertion::Clock,
    parameters: &[Parameter::linear("share", "1", (0.0, 0.4))],
    channels: &[Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::Speed, Channel::YawRate, Channel::Ax, Channel::Ay],
    suspect: true,
    apply: |values, plant| {
        plant.clock.repeated_share += values[0];
    },
};

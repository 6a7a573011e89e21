//! `clock_drift`: Age of the pose that grows during the drive.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "clock_drift",
    insertion: Insertion::Clock,
    parameters: &[Parameter::linear("rate", "s/s", (0.0, 0.01)).usual(0.0, 0.0001)],
    channels: &[Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::Speed],
    suspect: true,
    apply: |values, plant| {
        plant.clock.pose_drift += values[0];
    },
};

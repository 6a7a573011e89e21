//! `imu_latency`: Age of gyro and accelerometer samples.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "imu_latency",
    insertion: Insertion::Clock,
    parameters: &[Parameter::linear("latency", "s", (0.0, 0.3)).usual(0.008, 0.006)],
    channels: &[Channel::YawRate, Channel::Ax, Channel::Ay],
    suspect: true,
    apply: |values, plant| {
        plant.clock.imu_latency_secs += values[0];
    },
};

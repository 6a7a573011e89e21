//! `wheel_slip`: Longitudinal slip of the wheels under drive and brake force; never accused, every tyre has some.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "wheel_slip",
    insertion: Insertion::Sensor,
    parameters: &[Parameter::linear("slip", "s^2/m", (0.0, 0.02)).usual(0.004, 0.003)],
    channels: &[Channel::WheelSpeed],
    suspect: false,
    apply: |values, plant| {
        plant.sensors.wheel_slip_s2_m += values[0];
    },
};

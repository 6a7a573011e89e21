//! `wheel_scale`: Factor on wheel speed (tyre radius).
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "wheel_scale",
    insertion: Insertion::Sensor,
    parameters: &[Parameter::factor("factor", (-0.105, 0.095)).usual(0.0, 0.0016)],
    channels: &[Channel::WheelSpeed],
    suspect: true,
    apply: |values, plant| {
        plant.sensors.wheel_factor *= values[0];
    },
};

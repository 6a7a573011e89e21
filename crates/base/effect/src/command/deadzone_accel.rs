//! `deadzone_accel`: Small requests for force that have no effect.
//! The neutral value leaves the simulator untouched.

use crate::signal::{Place, dead_zone};
use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "deadzone_accel",
    insertion: Insertion::CommandPath,
    parameters: &[Parameter::threshold("width", "m/s^2", (0.0, 0.4))],
    channels: &[Channel::Speed, Channel::Ax, Channel::WheelSpeed, Channel::Dx],
    suspect: true,
    apply: |values, plant| {
        let width = values[0];
        if width > 0.0 {
            plant.traction.operators.push((Place::Command, Box::new(move |signal, _| dead_zone(signal, width))));
        }
    },
};

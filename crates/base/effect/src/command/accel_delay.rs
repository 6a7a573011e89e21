//! `accel_delay`: Dead time between the request for force and the drive or brake.
//! The neutral value leaves the simulator untouched.

use crate::signal::{Place, delay};
use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "accel_delay",
    insertion: Insertion::CommandPath,
    parameters: &[Parameter::linear("delay", "s", (0.0, 0.5)).usual(0.012, 0.008)],
    channels: &[Channel::Speed, Channel::Ax, Channel::WheelSpeed, Channel::Dx],
    suspect: true,
    apply: |values, plant| {
        let secs = values[0];
        if secs != 0.0 {
            plant
                .traction
                .operators
                .push((Place::Command, Box::new(move |signal, context| delay(signal, context.step_secs, secs))));
        }
    },
};

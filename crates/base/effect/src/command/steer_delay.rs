//! `steer_delay`: Dead time between the steering command and the servo; keeps the amplitude, unlike a lag.
//! The neutral value leaves the simulator untouched.

use crate::signal::{Place, delay};
use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "steer_delay",
    insertion: Insertion::CommandPath,
    parameters: &[Parameter::linear("delay", "s", (0.0, 0.4)).usual(0.012, 0.008)],
    channels: &[Channel::SteerMeas, Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::YawRate, Channel::Ay],
    suspect: true,
    apply: |values, plant| {
        let secs = values[0];
        if secs != 0.0 {
            plant
                .steering
                .operators
                .push((Place::Command, Box::new(move |signal, context| delay(signal, context.step_secs, secs))));
        }
    },
};

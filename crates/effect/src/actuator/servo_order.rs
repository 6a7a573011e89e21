//! `servo_order`: Second-order part of the steering servo: an own lag moved behind an equal lead time; never accused, every servo has some.
//! The neutral value leaves the simulator untouched.

use crate::signal::{Place, lag};
use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "servo_order",
    insertion: Insertion::Actuator,
    parameters: &[Parameter::linear("time_constant", "s", (0.0, 0.1)).usual(0.015, 0.010)],
    channels: &[Channel::SteerMeas, Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::YawRate, Channel::Ay],
    suspect: false,
    apply: |values, plant| {
        let secs = values[0];
        if secs != 0.0 {
            let secs = secs.clamp(-0.05, 0.8 * plant.steering.lag_secs);
            plant.steering.lag_secs -= secs;
            plant
                .steering
                .operators
                .push((Place::Command, Box::new(move |signal, context| lag(signal, context.step_secs, secs))));
        }
    },
};

//! `steer_rate`: Greatest rate of the steering servo, at the road wheel.
//! The neutral value leaves the simulator untouched.

use crate::signal::{Place, slew};
use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "steer_rate",
    insertion: Insertion::Actuator,
    parameters: &[Parameter::limit("rate", "rad/s", (-3.0, -0.5))],
    channels: &[Channel::SteerMeas, Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::YawRate, Channel::Ay],
    suspect: true,
    apply: |values, plant| {
        let rate = values[0];
        if rate.is_finite() {
            plant
                .steering
                .operators
                .push((Place::Actuator, Box::new(move |signal, context| slew(signal, context.step_secs, rate))));
        }
    },
};

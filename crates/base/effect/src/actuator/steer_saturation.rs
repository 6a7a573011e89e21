//! `steer_saturation`: Greatest road-wheel angle the servo reaches.
//! The neutral value leaves the simulator untouched.

use crate::signal::{Place, saturate};
use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "steer_saturation",
    insertion: Insertion::Actuator,
    parameters: &[Parameter::limit("angle", "rad", (-3.5, -0.5))],
    channels: &[Channel::SteerMeas, Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::YawRate, Channel::Ay],
    suspect: true,
    apply: |values, plant| {
        let limit = values[0];
        if limit.is_finite() {
            plant.steering.operators.push((Place::Actuator, Box::new(move |signal, _| saturate(signal, limit))));
        }
    },
};

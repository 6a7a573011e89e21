//! `servo_order`: Second-order servo: the same lag with an inertia term, 1 / (1 + lag s + inertia s^2); never accused, every servo has some.
//! The neutral value leaves the simulator untouched.

use crate::signal::{Place, second_order};
use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "servo_order",
    insertion: Insertion::Actuator,
    parameters: &[Parameter::linear("inertia", "s^2", (0.0, 0.004)).usual(0.0012, 0.0004)],
    channels: &[Channel::SteerMeas, Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::YawRate, Channel::Ay],
    suspect: false,
    apply: |values, plant| {
        let inertia = values[0];
        if inertia != 0.0 {
            let lag_secs = plant.steering.lag_secs;
            plant.steering.lag_secs = 0.0;
            plant.steering.operators.push((
                Place::Command,
                Box::new(move |signal, context| second_order(signal, context.step_secs, lag_secs, inertia.max(1e-5))),
            ));
        }
    },
};

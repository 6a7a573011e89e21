//! `steer_lag`: Extra first-order time constant of the steering servo; a negative value speeds the nominal servo up.
//! The neutral value leaves the simulator untouched.

use crate::signal::{Place, lag};
use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "steer_lag",
    insertion: Insertion::Actuator,
    parameters: &[Parameter::linear("time_constant", "s", (0.0, 0.6)).usual(0.0, 0.010)],
    channels: &[Channel::SteerMeas, Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::YawRate, Channel::Ay],
    suspect: true,
    apply: |values, plant| {
        let secs = values[0];
        if secs > 0.0 {
            plant
                .steering
                .operators
                .push((Place::Command, Box::new(move |signal, context| lag(signal, context.step_secs, secs))));
        } else {
            plant.steering.lag_secs = (plant.steering.lag_secs + secs).max(0.0);
        }
    },
};

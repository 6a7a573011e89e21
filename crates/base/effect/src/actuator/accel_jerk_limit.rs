//! `accel_jerk_limit`: Greatest rate of change of the realised acceleration.
//! The neutral value leaves the simulator untouched.

use crate::signal::{Place, slew};
use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "accel_jerk_limit",
    insertion: Insertion::Actuator,
    parameters: &[Parameter::limit("jerk", "m/s^3", (-0.7, 2.3))],
    channels: &[Channel::Speed, Channel::Ax, Channel::WheelSpeed, Channel::Dx],
    suspect: true,
    apply: |values, plant| {
        let jerk = values[0];
        if jerk.is_finite() {
            plant
                .traction
                .operators
                .push((Place::Actuator, Box::new(move |signal, context| slew(signal, context.step_secs, jerk))));
        }
    },
};

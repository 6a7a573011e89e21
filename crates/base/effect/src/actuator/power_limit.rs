//! `power_limit`: Greatest drive power over mass; bounds positive acceleration at speed.
//! The neutral value leaves the simulator untouched.

use crate::signal::Place;
use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "power_limit",
    insertion: Insertion::Actuator,
    parameters: &[Parameter::limit("power", "W/kg", (1.6, 4.1))],
    channels: &[Channel::Speed, Channel::Ax, Channel::WheelSpeed, Channel::Dx],
    suspect: true,
    apply: |values, plant| {
        let power = values[0];
        if power.is_finite() {
            plant.traction.operators.push((
                Place::Actuator,
                Box::new(move |signal, context| {
                    for (s, speed) in signal.iter_mut().zip(context.speed_mps) {
                        *s = s.min(power / speed.max(1.0));
                    }
                }),
            ));
        }
    },
};

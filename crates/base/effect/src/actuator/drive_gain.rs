//! `drive_gain`: Factor on positive force requests.
//! The neutral value leaves the simulator untouched.

use crate::signal::Place;
use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "drive_gain",
    insertion: Insertion::Actuator,
    parameters: &[Parameter::factor("factor", (-0.511, 0.095)).usual(0.0, 0.012)],
    channels: &[Channel::Speed, Channel::Ax, Channel::WheelSpeed, Channel::Dx],
    suspect: true,
    apply: |values, plant| {
        let factor = values[0];
        if factor != 1.0 {
            plant.traction.operators.push((
                Place::Actuator,
                Box::new(move |signal, _| signal.iter_mut().filter(|s| **s > 0.0).for_each(|s| *s *= factor)),
            ));
        }
    },
};

//! `steer_gain`: Factor between the servo and the road wheel, behind the position sensor.
//! The neutral value leaves the simulator untouched.

use crate::signal::Place;
use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "steer_gain",
    insertion: Insertion::Actuator,
    parameters: &[Parameter::factor("factor", (-0.223, 0.182)).usual(0.0, 0.006)],
    channels: &[Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::YawRate, Channel::Ay],
    suspect: true,
    apply: |values, plant| {
        let factor = values[0];
        if factor != 1.0 {
            plant
                .steering
                .operators
                .push((Place::Linkage, Box::new(move |signal, _| signal.iter_mut().for_each(|s| *s *= factor))));
        }
    },
};

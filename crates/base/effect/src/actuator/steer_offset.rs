//! `steer_offset`: Zero error of the road wheel, behind the position sensor.
//! The neutral value leaves the simulator untouched.

use crate::signal::Place;
use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "steer_offset",
    insertion: Insertion::Actuator,
    parameters: &[Parameter::linear("angle", "rad", (-0.02, 0.02)).usual(0.0, 0.001)],
    channels: &[Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::YawRate, Channel::Ay],
    suspect: true,
    apply: |values, plant| {
        let angle = values[0];
        if angle != 0.0 {
            plant
                .steering
                .operators
                .push((Place::Linkage, Box::new(move |signal, _| signal.iter_mut().for_each(|s| *s += angle))));
        }
    },
};

//! `steer_backlash`: Play between the steering servo and the road wheel: the wheel stays behind at each reversal.
//! The neutral value leaves the simulator untouched.

use crate::signal::{Place, play};
use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "steer_backlash",
    insertion: Insertion::Actuator,
    parameters: &[Parameter::threshold("play", "rad", (0.0, 0.03))],
    channels: &[Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::YawRate, Channel::Ay],
    suspect: true,
    apply: |values, plant| {
        let width = values[0];
        if width > 0.0 {
            plant.steering.operators.push((Place::Linkage, Box::new(move |signal, _| play(signal, width))));
        }
    },
};

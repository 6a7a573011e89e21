//! `brake_fade`: Loss of brake force per megajoule of brake work since the drive began.
//! The neutral value leaves the simulator untouched.

use crate::signal::Place;
use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "brake_fade",
    insertion: Insertion::Actuator,
    parameters: &[Parameter::linear("loss", "1/MJ", (0.0, 0.3))],
    channels: &[Channel::Speed, Channel::Ax, Channel::WheelSpeed, Channel::Dx],
    suspect: true,
    apply: |values, plant| {
        let loss = values[0];
        if loss != 0.0 {
            plant.traction.operators.push((
                Place::Actuator,
                Box::new(move |signal, context| {
                    for (s, work) in signal.iter_mut().zip(context.brake_work_mj) {
                        if *s < 0.0 {
                            *s *= (1.0 - loss * work).max(0.1);
                        }
                    }
                }),
            ));
        }
    },
};

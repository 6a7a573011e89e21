//! `cmd_hold_rate`: Commands refreshed at a low rate and held between refreshes; the phase of the refresh is unknown, so this is the average over it, a moving mean over one period.
//! The neutral value leaves the simulator untouched.

use crate::signal::{Place, moving_mean};
use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "cmd_hold_rate",
    insertion: Insertion::CommandPath,
    parameters: &[Parameter::limit("rate", "Hz", (1.3, 3.9))],
    channels: &[
        Channel::SteerMeas,
        Channel::Dx,
        Channel::Dy,
        Channel::Dyaw,
        Channel::YawRate,
        Channel::Ay,
        Channel::Speed,
        Channel::Ax,
        Channel::WheelSpeed,
    ],
    suspect: true,
    apply: |values, plant| {
        let rate_hz = values[0];
        if rate_hz.is_finite() {
            plant.steering.operators.push((
                Place::Command,
                Box::new(move |signal, context| moving_mean(signal, context.step_secs, 1.0 / rate_hz)),
            ));
            plant.traction.operators.push((
                Place::Command,
                Box::new(move |signal, context| moving_mean(signal, context.step_secs, 1.0 / rate_hz)),
            ));
        }
    },
};

//! `accel_lag`: Extra first-order time constant of drive and brake; a negative value speeds the nominal one up.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "accel_lag",
    insertion: Insertion::Actuator,
    parameters: &[Parameter::linear("time_constant", "s", (0.0, 0.8)).usual(0.0, 0.010)],
    channels: &[Channel::Speed, Channel::Ax, Channel::WheelSpeed, Channel::Dx],
    suspect: true,
    apply: |values, plant| {
        // the same stage grown slower, as its nominal lag is given
        plant.traction.lag_secs = (plant.traction.lag_secs + values[0]).max(0.0);
    },
};

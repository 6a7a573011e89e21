//! `mu`: Friction between tyre and road as a factor on the nominal coefficient; side forces saturate at what drive and brakes leave
//! of friction times load.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "mu",
    insertion: Insertion::Vehicle,
    parameters: &[Parameter { scale: crate::Scale::Log, ..Parameter::factor("factor", (-1.61, 0.0)).usual(0.0, 0.09) }],
    channels: &[
        Channel::Dx,
        Channel::Dy,
        Channel::Dyaw,
        Channel::Speed,
        Channel::YawRate,
        Channel::Ax,
        Channel::Ay,
        Channel::WheelSpeed,
    ],
    suspect: true,
    apply: |values, plant| {
        plant.vehicle.friction *= values[0];
        if values[0] != 1.0 {
            plant.vehicle.friction_circle.get_or_insert_default();
        }
    },
};

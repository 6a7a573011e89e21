//! `wind_steady`: Steady wind, east and north component; felt by speed and heading, depends on the direction of travel.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "wind_steady",
    insertion: Insertion::Road,
    parameters: &[
        Parameter::linear("east", "m/s", (-12.0, 12.0)).usual(0.0, 0.5),
        Parameter::linear("north", "m/s", (-12.0, 12.0)).usual(0.0, 0.5),
    ],
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
        plant.road.wind_x_mps += values[0];
        plant.road.wind_y_mps += values[1];
    },
};

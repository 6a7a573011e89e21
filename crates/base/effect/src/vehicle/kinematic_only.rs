//! `kinematic_only`: A reference whose wheels do not slip sideways (a switch): turning follows the steering angle alone.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "kinematic_only",
    insertion: Insertion::Vehicle,
    parameters: &[Parameter { slab: (1.0, 1.0), ..Parameter::threshold("on", "1", (0.0, 1.0)) }],
    channels: &[Channel::Dx, Channel::Dy, Channel::Dyaw, Channel::YawRate, Channel::Ay],
    suspect: true,
    apply: |values, plant| {
        if values[0] > 0.5 {
            plant.vehicle.front_stiffness_n *= 40.0;
            plant.vehicle.rear_stiffness_n *= 40.0;
            plant.vehicle.friction *= 40.0;
        }
    },
};

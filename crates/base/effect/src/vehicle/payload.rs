//! `payload`: Load on board: more mass at the centre of gravity and half as much more inertia; axle friction grows with it.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "payload",
    insertion: Insertion::Vehicle,
    parameters: &[Parameter::linear("mass", "kg", (0.0, 0.4)).of_mass().usual(0.012, 0.015)],
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
        let mass_kg = values[0];
        let vehicle = &mut plant.vehicle;
        vehicle.yaw_inertia_kg_m2 *= 1.0 + 0.5 * mass_kg / vehicle.nominal_mass_kg;
        vehicle.mass_kg += mass_kg;
    },
};

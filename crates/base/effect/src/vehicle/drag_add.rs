//! `drag_add`: Added drag area; air density 1.2 kg/m3.
//! The neutral value leaves the simulator untouched.

use crate::{Channel, Effect, Insertion, Parameter};

pub(crate) const EFFECT: Effect = Effect {
    id: "drag_add",
    insertion: Insertion::Vehicle,
    parameters: &[Parameter::linear("drag_area", "m^2 (CdA)", (-0.2, 3.0)).usual(0.0, 0.04)],
    channels: &[Channel::Speed, Channel::Ax, Channel::WheelSpeed, Channel::Dx],
    suspect: true,
    apply: |values, plant| {
        plant.vehicle.drag_n_s2_m2 += 0.5 * 1.2 * values[0];
    },
};

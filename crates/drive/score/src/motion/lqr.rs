//! The command at one step of the score's own simulation: the LQR of `ds_vehicle` on its reference (PDM `batch_lqr.py`).
//!
//! Additions run in the order with which the answers of reference cases are on record ([`Sums::Changes`]).

use ds_space::angle::wrap;
use ds_space::{DVec2, PoseSe2};
use ds_vehicle::lqr::{Errors, Motion, PREVIEW, Sums, acceleration_mps2, steering_rate_radps};
use ds_vehicle::{Command, stopping};

use super::VehicleState;
use crate::constants::horizon::{DT_S, STATES, STEPS};

/// What is tracked: poses, their directions, and the profiles fitted to them.
pub(crate) struct Reference<'a> {
    pub(crate) poses: &'a [PoseSe2; STATES],
    pub(crate) directions: &'a [DVec2; STATES],
    pub(crate) speeds: &'a [f64; STEPS],
    pub(crate) curvatures: &'a [f64; STEPS],
}

pub(crate) fn command(reference: &Reference<'_>, step: usize, ego: &VehicleState, wheel_base_m: f64) -> Command {
    let speed_mps = ego.vx_mps;
    let ahead = |steps: usize| (step + steps).min(STEPS - 1);
    let reference_mps = reference.speeds[ahead(PREVIEW)];
    if let Some(command) = stopping(speed_mps, reference_mps) {
        return command;
    }
    let acceleration_mps2 = acceleration_mps2(speed_mps, reference_mps, DT_S);
    let pose = &reference.poses[step];
    let errors = Errors {
        lateral_m: reference.directions[step].perp_dot(ego.position() - pose.position),
        heading_rad: wrap(ego.heading_rad - pose.heading_rad),
        steering_rad: ego.steering_rad,
    };
    let motion = Motion { speed_mps, acceleration_mps2, wheel_base_m, dt_secs: DT_S };
    let curvature = |i: usize| reference.curvatures[ahead(i)];
    Command { acceleration_mps2, steering_rate_radps: steering_rate_radps(errors, &motion, Sums::Changes, curvature) }
}

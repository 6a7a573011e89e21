//! The command at one step: speed over one step of 1 s, lateral error over ten steps of a tick (PDM `batch_lqr.py`).
//!
//! Lateral state (offset, heading error, steering angle) on a kinematic bicycle linearised about the reference:
//! z = A·e + g, steering rate = −(Bᵀ·Q·z)/(Bᵀ·Q·B + 1) with Q = diag(1, 10, 0).

use ds_space::angle::wrap;
use ds_space::{DVec2, PoseSe2};

use super::VehicleState;
use crate::constants::horizon::{DT_S, STATES, STEPS};
use crate::constants::tracker::{HEADING_WEIGHT, OFFSET_WEIGHT, PREVIEW, SPEED_WEIGHT, STOPPING_GAIN, STOPPING_MPS};

/// What is tracked: poses, their directions, and the profiles fitted to them.
pub(crate) struct Reference<'a> {
    pub(crate) poses: &'a [PoseSe2; STATES],
    pub(crate) directions: &'a [DVec2; STATES],
    pub(crate) speeds: &'a [f64; STEPS],
    pub(crate) curvatures: &'a [f64; STEPS],
}

/// What the tracker asks of the car.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Command {
    pub(crate) acceleration_mps2: f64,
    pub(crate) steering_rate_radps: f64,
}

pub(crate) fn command(reference: &Reference<'_>, step: usize, ego: &VehicleState, wheel_base_m: f64) -> Command {
    let speed_mps = ego.vx_mps;
    let ahead = (step + PREVIEW).min(STEPS - 1);
    let reference_mps = reference.speeds[ahead];
    let excess_mps = speed_mps - reference_mps;
    if reference_mps <= STOPPING_MPS && speed_mps <= STOPPING_MPS {
        return Command { acceleration_mps2: -STOPPING_GAIN * excess_mps, steering_rate_radps: 0.0 };
    }
    let acceleration_mps2 = -SPEED_WEIGHT / (SPEED_WEIGHT + 1.0) * excess_mps;
    let direction = reference.directions[step];
    let offset = ego.position() - reference.poses[step].position;
    let mut lateral_m = direction.perp_dot(offset);
    let mut heading_rad = wrap(ego.heading_rad - reference.poses[step].heading_rad);
    // Column of the steering rate: how it moves offset and heading by the end.
    let (mut lateral_gain, mut heading_gain) = (0.0, 0.0);
    for i in 0..PREVIEW {
        let travel_m = (speed_mps + i as f64 * DT_S * acceleration_mps2) * DT_S;
        let turn = travel_m / wheel_base_m;
        let curvature = reference.curvatures[(step + i).min(ahead)];
        lateral_m += travel_m * heading_rad;
        heading_rad += turn * ego.steering_rad - travel_m * curvature;
        lateral_gain += travel_m * heading_gain;
        heading_gain += turn * (i as f64 * DT_S);
    }
    let heading_rad = wrap(heading_rad);
    let pull = OFFSET_WEIGHT * lateral_gain * lateral_m + HEADING_WEIGHT * heading_gain * heading_rad;
    let stiffness = OFFSET_WEIGHT * lateral_gain * lateral_gain + HEADING_WEIGHT * heading_gain * heading_gain + 1.0;
    Command { acceleration_mps2, steering_rate_radps: -pull / stiffness }
}

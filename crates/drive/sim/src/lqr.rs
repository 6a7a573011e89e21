//! The LQR tracker of nuPlan and NAVSIM: speed over one step of 1 s, lateral error over ten steps of a tick.
//!
//! Lateral state (offset, heading error, steering angle) on a kinematic bicycle linearised about the reference:
//! z = A·e + g, steering rate = −(Bᵀ·Q·z)/(Bᵀ·Q·B + 1) with Q = diag(1, 10, 0). Longitudinal q = 10, r = 1.

use ds_space::angle::wrap;
use ds_world::EgoState;

use crate::profile::Profile;
use crate::reference::Reference;
use crate::tracker::{Command, stopping};

/// Ticks of preview.
const PREVIEW: usize = 10;
const SPEED_WEIGHT: f64 = 10.0;
const HEADING_WEIGHT: f64 = 10.0;

/// Returns the command at `step` ticks after the plan.
pub(crate) fn command(
    reference: &Reference,
    profile: &Profile,
    step: usize,
    ego: &EgoState,
    wheel_base_m: f64,
) -> Command {
    let speed_mps = ego.speed_mps();
    let last = reference.steps() - 1;
    let ahead = (step + PREVIEW).min(last);
    let reference_mps = if step > last { 0.0 } else { profile.speed_mps[ahead] };
    if let Some(command) = stopping(speed_mps, reference_mps) {
        return command;
    }
    let dt = reference.dt_secs;
    let preview_secs = PREVIEW as f64 * dt;
    let gain = SPEED_WEIGHT * preview_secs / (SPEED_WEIGHT * preview_secs * preview_secs + 1.0);
    let acceleration_mps2 = -gain * (speed_mps - reference_mps);

    let target = reference.pose(step);
    let offset = ego.pose.position - target.position;
    let (sin, cos) = target.heading_rad.sin_cos();
    let mut z = [offset.y * cos - offset.x * sin, wrap(ego.pose.heading_rad - target.heading_rad), ego.steering_rad];
    let mut b = [0.0; 3];
    for i in 0..PREVIEW {
        let travel_m = (speed_mps + i as f64 * dt * acceleration_mps2) * dt;
        let curvature = if step > last { 0.0 } else { profile.curvature_per_m[(step + i).min(ahead)] };
        z = advance(z, travel_m, wheel_base_m);
        z[1] -= travel_m * curvature;
        b = advance(b, travel_m, wheel_base_m);
        b[2] += dt;
    }
    let (lateral_m, heading_rad) = (z[0], wrap(z[1]));
    let steering_rate_radps =
        -(b[0] * lateral_m + HEADING_WEIGHT * b[1] * heading_rad) / (b[0] * b[0] + HEADING_WEIGHT * b[1] * b[1] + 1.0);
    Command { acceleration_mps2, steering_rate_radps }
}

fn advance(state: [f64; 3], travel_m: f64, wheel_base_m: f64) -> [f64; 3] {
    [state[0] + travel_m * state[1], state[1] + travel_m / wheel_base_m * state[2], state[2]]
}

#[cfg(test)]
mod tests;

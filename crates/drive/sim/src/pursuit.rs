//! Pure pursuit: steers along the arc to a point ahead on the plan; speed from the plan's timing.
//!
//! Look-ahead 0.8 s of travel, at least 4 m and at most 25 m; δ = atan(2·L·sin α / d). Acceleration from the errors of
//! speed (half a second ahead) and of position along the plan.

use ds_space::DVec2;
use ds_world::EgoState;

use crate::profile::Profile;
use crate::reference::Reference;
use crate::tracker::{Command, STOPPING_MPS, stopping};

const LOOK_AHEAD_SECS: f64 = 0.8;
const LOOK_AHEAD_M: std::ops::RangeInclusive<f64> = 4.0..=25.0;
const SPEED_PREVIEW: usize = 5;
const SPEED_GAIN_PER_SEC: f64 = 2.0;
const POSITION_GAIN_PER_SEC: f64 = 0.33;
/// Time in which the steering should reach its target.
const STEERING_SECS: f64 = 0.1;

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
    let reference_mps = if step > last { 0.0 } else { profile.speed_mps[(step + SPEED_PREVIEW).min(last)] };
    if let Some(command) = stopping(speed_mps, reference_mps) {
        return command;
    }
    let look_ahead_m = (LOOK_AHEAD_SECS * speed_mps.abs()).clamp(*LOOK_AHEAD_M.start(), *LOOK_AHEAD_M.end());
    let target = ego.pose.to_local(target(reference, step, ego.pose.position, look_ahead_m));
    let squared = target.length_squared().max(1.0);
    let steering_rad = if target.x > 0.0 { (2.0 * wheel_base_m * target.y / squared).atan() } else { 0.0 };
    let behind_m = ego.pose.to_local(reference.pose(step).position).x;
    let mut wanted_mps = reference_mps + POSITION_GAIN_PER_SEC * behind_m.clamp(-5.0, 5.0);
    if reference_mps > -STOPPING_MPS {
        // A plan ahead is waited for, never reversed to.
        wanted_mps = wanted_mps.max(0.0);
    }
    Command {
        acceleration_mps2: SPEED_GAIN_PER_SEC * (wanted_mps - speed_mps),
        steering_rate_radps: (steering_rad - ego.steering_rad) / STEERING_SECS,
    }
}

/// Returns the first planned position at the look-ahead distance, or one on the straight continuation of the plan.
fn target(reference: &Reference, step: usize, from: DVec2, look_ahead_m: f64) -> DVec2 {
    let start = step.min(reference.steps());
    for pose in &reference.poses[start..] {
        if (pose.position - from).length() >= look_ahead_m {
            return pose.position;
        }
    }
    let end = reference.pose(reference.steps());
    let left_m = look_ahead_m - (end.position - from).length();
    end.position + end.forward() * left_m.max(0.0)
}

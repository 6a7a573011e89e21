//! Pure pursuit: steers along the arc to a point ahead on the plan; speed from the plan's timing.
//!
//! Look-ahead 0.8 s of travel, at least 4 m and at most 25 m; δ = atan(2·L·sin α / d). Acceleration from the errors of
//! speed (half a second ahead) and of position along the plan.

use ds_space::DVec2;

use super::{Command, Moment, Reference, STOPPING_MPS};

/// Ticks by which the plan's speed is looked ahead.
pub(super) const SPEED_PREVIEW: usize = 5;
const LOOK_AHEAD_SECS: f64 = 0.8;
const LOOK_AHEAD_M: std::ops::RangeInclusive<f64> = 4.0..=25.0;
const SPEED_GAIN_PER_SEC: f64 = 2.0;
const POSITION_GAIN_PER_SEC: f64 = 0.33;
/// Time in which the steering should reach its target.
const STEERING_SECS: f64 = 0.1;

pub(super) fn command(now: &Moment<'_>, reference_mps: f64) -> Command {
    let (ego, reference) = (now.ego, now.reference);
    let speed_mps = ego.speed_mps();
    let look_ahead_m = (LOOK_AHEAD_SECS * speed_mps.abs()).clamp(*LOOK_AHEAD_M.start(), *LOOK_AHEAD_M.end());
    let target = ego.pose.to_local(target(reference, now.step, ego.pose.position, look_ahead_m));
    let squared = target.length_squared().max(1.0);
    let steering_rad = if target.x > 0.0 { (2.0 * now.wheel_base_m * target.y / squared).atan() } else { 0.0 };
    let behind_m = ego.pose.to_local(reference.pose(now.step).position).x;
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

//! The LQR tracker of nuPlan and NAVSIM: speed over one step of 1 s, lateral error over ten steps of a tick.
//!
//! Lateral state (offset, heading error, steering angle) on a kinematic bicycle linearised about the reference:
//! z = A·e + g, steering rate = −(Bᵀ·Q·z)/(Bᵀ·Q·B + 1) with Q = diag(1, 10, 0). Longitudinal q = 10, r = 1.
//! Numbers are those of PDM `simulation/batch_lqr.py:60-73`. The simulator and the scores' simulation of a plan both ask here.

use ds_space::angle::wrap;

use super::{Command, Moment};

/// Ticks of preview.
pub const PREVIEW: usize = 10;
const SPEED_WEIGHT: f64 = 10.0;
const HEADING_WEIGHT: f64 = 10.0;

/// A car beside its reference.
#[derive(Debug, Clone, Copy)]
pub struct Errors {
    /// To the left of the reference pose, in metres.
    pub lateral_m: f64,
    /// Against its heading, in radians.
    pub heading_rad: f64,
    /// Angle of the road wheel, in radians.
    pub steering_rad: f64,
}

/// How the car goes on while the errors are foreseen.
#[derive(Debug, Clone, Copy)]
pub struct Motion {
    /// Its speed now, in metres per second.
    pub speed_mps: f64,
    /// Its acceleration, in metres per second squared.
    pub acceleration_mps2: f64,
    /// Of the kinematic car, in metres.
    pub wheel_base_m: f64,
    /// Time between steps, in seconds.
    pub dt_secs: f64,
}

/// The order of additions in the preview: the same sums but for their last digits, which digests and reference answers
/// hold.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sums {
    /// State by state, as the simulator steps.
    Stepwise,
    /// Changes first, as in the scores.
    Changes,
}

/// Returns the acceleration that meets a reference speed, in metres per second squared.
#[inline]
#[must_use]
pub fn acceleration_mps2(speed_mps: f64, reference_mps: f64, dt_secs: f64) -> f64 {
    let preview_secs = PREVIEW as f64 * dt_secs;
    let gain = SPEED_WEIGHT * preview_secs / (SPEED_WEIGHT * preview_secs * preview_secs + 1.0);
    -gain * (speed_mps - reference_mps)
}

/// Returns the rate of the road wheel that meets the reference, in radians per second; `curvature_per_m` gives the
/// reference's at each step of the preview.
#[inline]
#[must_use]
pub fn steering_rate_radps(errors: Errors, motion: &Motion, sums: Sums, curvature_per_m: impl Fn(usize) -> f64) -> f64 {
    let Errors { mut lateral_m, mut heading_rad, steering_rad } = errors;
    let dt_secs = motion.dt_secs;
    // How a steering rate moves offset, heading and angle by the end.
    let (mut lateral_gain, mut heading_gain, mut angle_gain) = (0.0, 0.0, 0.0);
    for i in 0..PREVIEW {
        let travel_m = (motion.speed_mps + i as f64 * dt_secs * motion.acceleration_mps2) * dt_secs;
        let turn = travel_m / motion.wheel_base_m;
        let bend_rad = travel_m * curvature_per_m(i);
        lateral_m += travel_m * heading_rad;
        lateral_gain += travel_m * heading_gain;
        match sums {
            Sums::Stepwise => heading_rad = heading_rad + turn * steering_rad - bend_rad,
            Sums::Changes => {
                heading_rad += turn * steering_rad - bend_rad;
                angle_gain = i as f64 * dt_secs;
            }
        }
        heading_gain += turn * angle_gain;
        angle_gain += dt_secs;
    }
    let heading_rad = wrap(heading_rad);
    let pull = lateral_gain * lateral_m + HEADING_WEIGHT * heading_gain * heading_rad;
    -pull / (lateral_gain * lateral_gain + HEADING_WEIGHT * heading_gain * heading_gain + 1.0)
}

pub(super) fn command(now: &Moment<'_>, reference_mps: f64) -> Command {
    let (ego, dt_secs) = (now.ego, now.reference.dt_secs);
    let speed_mps = ego.speed_mps();
    let acceleration_mps2 = acceleration_mps2(speed_mps, reference_mps, dt_secs);
    let target = now.reference.pose(now.step);
    let offset = ego.pose.position - target.position;
    let (sin, cos) = target.heading_rad.sin_cos();
    let errors = Errors {
        lateral_m: offset.y * cos - offset.x * sin,
        heading_rad: wrap(ego.pose.heading_rad - target.heading_rad),
        steering_rad: ego.steering_rad,
    };
    let motion = Motion { speed_mps, acceleration_mps2, wheel_base_m: now.wheel_base_m, dt_secs };
    let curvature = |i: usize| if now.past() { 0.0 } else { now.profile.curvature_per_m[now.ahead(i)] };
    Command { acceleration_mps2, steering_rate_radps: steering_rate_radps(errors, &motion, Sums::Stepwise, curvature) }
}

#[cfg(test)]
mod tests;

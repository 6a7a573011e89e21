//! Follows a plan: the reference of the plan and the controller that turns the ego's state into commands.

use ds_space::{PoseSe2, SimTime, Tick};
use ds_world::{EgoState, TrackerKind, Trajectory};

use crate::lqr;
use crate::profile::Profile;
use crate::pursuit;
use crate::reference::Reference;

/// What a controller asks of the actuators.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Command {
    pub(crate) acceleration_mps2: f64,
    pub(crate) steering_rate_radps: f64,
}

/// Below this speed a standing reference is met by gentle braking alone.
pub(crate) const STOPPING_MPS: f64 = 0.2;
const STOPPING_GAIN_PER_SEC: f64 = 0.5;

/// A plan being followed.
#[derive(Debug, Clone)]
pub(crate) struct Tracker {
    pub(crate) plan: Trajectory,
    pub(crate) anchor: PoseSe2,
    pub(crate) plan_tick: Tick,
    kind: TrackerKind,
    reference: Reference,
    profile: Profile,
}

impl Tracker {
    /// Anchors a plan at the pose that the ego had at the plan's tick.
    pub(crate) fn new(plan: Trajectory, border: (Tick, PoseSe2), dt: SimTime, kind: TrackerKind) -> Self {
        let (plan_tick, anchor) = border;
        let reference = Reference::new(&plan, anchor, dt);
        let profile = Profile::of(&reference);
        Self { plan, anchor, plan_tick, kind, reference, profile }
    }

    /// Returns the command for the step that begins at `tick`. Past its end the plan is a standing one.
    /// The wheel base is that of the kinematic car which turns like the ego at its speed.
    pub(crate) fn command(&self, ego: &EgoState, tick: Tick, wheel_base_m: f64) -> Command {
        let step = tick.0.saturating_sub(self.plan_tick.0) as usize;
        match self.kind {
            TrackerKind::Lqr => lqr::command(&self.reference, &self.profile, step, ego, wheel_base_m),
            TrackerKind::PurePursuit => pursuit::command(&self.reference, &self.profile, step, ego, wheel_base_m),
        }
    }
}

/// Returns the command that brings a nearly standing car to its nearly standing reference.
pub(crate) fn stopping(speed_mps: f64, reference_mps: f64) -> Option<Command> {
    (speed_mps <= STOPPING_MPS && reference_mps <= STOPPING_MPS).then(|| Command {
        acceleration_mps2: -STOPPING_GAIN_PER_SEC * (speed_mps - reference_mps),
        steering_rate_radps: 0.0,
    })
}

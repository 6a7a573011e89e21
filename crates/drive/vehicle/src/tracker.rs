//! Follows a plan: the reference of the plan and the controller that turns the ego's state into commands.

use ds_space::{PoseSe2, SimTime, Tick};
use ds_world::{EgoState, TrackerKind, Trajectory};

mod banded;
pub mod lqr;
mod profile;
mod pursuit;
mod reference;

pub use profile::Profile;
pub use reference::Reference;

/// What a controller asks of the actuators.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Command {
    /// In metres per second squared.
    pub acceleration_mps2: f64,
    /// Of the road wheel, in radians per second.
    pub steering_rate_radps: f64,
}

/// Below this speed a standing reference is met by gentle braking alone, in metres per second.
const STOPPING_MPS: f64 = 0.2;
const STOPPING_GAIN_PER_SEC: f64 = 0.5;

/// A plan being followed.
#[derive(Debug, Clone)]
pub struct Tracker {
    plan: Trajectory,
    anchor: PoseSe2,
    plan_tick: Tick,
    kind: TrackerKind,
    reference: Reference,
    profile: Profile,
}

/// A plan at the step at which the ego is now.
struct Moment<'a> {
    reference: &'a Reference,
    profile: &'a Profile,
    /// Steps since the plan was made.
    step: usize,
    ego: &'a EgoState,
    wheel_base_m: f64,
}

impl Tracker {
    /// Anchors a plan at the pose that the ego had at the plan's tick; `dt` is the time between ticks.
    #[must_use]
    pub fn new(plan: Trajectory, border: (Tick, PoseSe2), dt: SimTime, kind: TrackerKind) -> Self {
        let (plan_tick, anchor) = border;
        let reference = Reference::new(&plan, anchor, dt);
        let profile = Profile::of(&reference);
        Self { plan, anchor, plan_tick, kind, reference, profile }
    }

    /// Returns the plan, its tick and its anchor: what makes the same tracker again.
    #[must_use]
    pub fn origin(&self) -> (&Trajectory, Tick, PoseSe2) {
        (&self.plan, self.plan_tick, self.anchor)
    }

    /// Returns the command for the step that begins at `tick`. Past its end the plan is a standing one.
    /// The wheel base is that of the kinematic car which turns like the ego at its speed.
    #[must_use]
    pub fn command(&self, ego: &EgoState, tick: Tick, wheel_base_m: f64) -> Command {
        let step = tick.0.saturating_sub(self.plan_tick.0) as usize;
        let (reference, profile) = (&self.reference, &self.profile);
        Moment { reference, profile, step, ego, wheel_base_m }.command(self.kind)
    }
}

impl Moment<'_> {
    fn command(&self, kind: TrackerKind) -> Command {
        let (preview, law): (usize, fn(&Self, f64) -> Command) = match kind {
            TrackerKind::Lqr => (lqr::PREVIEW, lqr::command),
            TrackerKind::PurePursuit => (pursuit::SPEED_PREVIEW, pursuit::command),
        };
        let reference_mps = if self.past() { 0.0 } else { self.profile.speed_mps[self.ahead(preview)] };
        stopping(self.ego.speed_mps(), reference_mps).unwrap_or_else(|| law(self, reference_mps))
    }

    /// Says whether the plan is over.
    fn past(&self) -> bool {
        self.step >= self.reference.steps()
    }

    /// Returns the displacement so many steps ahead, the last one held.
    fn ahead(&self, steps: usize) -> usize {
        (self.step + steps).min(self.reference.steps() - 1)
    }
}

/// Returns the command that brings a nearly standing car to its nearly standing reference; speeds in metres per second.
#[must_use]
pub fn stopping(speed_mps: f64, reference_mps: f64) -> Option<Command> {
    (speed_mps <= STOPPING_MPS && reference_mps <= STOPPING_MPS).then(|| Command {
        acceleration_mps2: -STOPPING_GAIN_PER_SEC * (speed_mps - reference_mps),
        steering_rate_radps: 0.0,
    })
}

//! What a policy is shown. The newest frame's moment is "now"; all poses are given in the rig frame of now.

use std::sync::Arc;

use ds_raster::RgbImage;
use ds_space::{CameraModel, DVec2, Draws, PoseSe2, SimTime, Tick};
use ds_world::{EgoState, RouteCommand, Scene, WorldState};

use crate::error::PolicyError;
use crate::plan::{PolicyAnswer, evenly_spaced};

/// The longest horizon that may be asked for, in ticks.
pub const MAX_HORIZON_TICKS: u32 = 256;

/// What a car knows of its own motion, without any absolute position.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EgoView {
    /// Forward speed, in metres per second.
    pub speed_mps: f64,
    /// Yaw rate, in radians per second, left positive.
    pub yaw_rate_radps: f64,
    /// Acceleration in the rig, in metres per second squared.
    pub acceleration_mps2: DVec2,
    /// Road-wheel angle, in radians, left positive.
    pub steering_rad: f64,
    /// Where the rig was at each stamp, in the rig frame of now, oldest first; the last is the identity.
    pub history: Vec<PoseSe2>,
}

impl EgoView {
    /// Makes the view of a car from its states at the stamps, oldest first, the last being now.
    #[must_use]
    pub fn of(states: &[EgoState]) -> Self {
        let Some(now) = states.last() else { return Self::default() };
        Self {
            speed_mps: now.speed_mps(),
            yaw_rate_radps: now.yaw_rate_radps,
            acceleration_mps2: now.acceleration_mps2,
            steering_rad: now.steering_rad,
            history: states.iter().map(|state| now.pose.relative(&state.pose)).collect(),
        }
    }

    fn is_finite(&self) -> bool {
        [self.speed_mps, self.yaw_rate_radps, self.steering_rad].iter().all(|value| value.is_finite())
            && self.acceleration_mps2.is_finite()
            && self.history.iter().all(PoseSe2::is_finite)
    }
}

/// One request to a policy.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    /// The last K frames of each camera, oldest first: `frames[camera][k]`.
    pub frames: Vec<Vec<RgbImage>>,
    /// Lens and mounting of each camera, in the order of `frames`.
    pub cameras: Vec<CameraModel>,
    /// The car's own motion.
    pub ego: EgoView,
    /// What the navigation says.
    pub command: RouteCommand,
    /// The simulation time of each of the K frames, oldest first.
    pub stamps: Vec<SimTime>,
    /// How many ticks the plan should cover.
    pub horizon_ticks: u32,
    /// The length of a tick.
    pub dt: SimTime,
    /// The policy's own random draws of this moment.
    pub draw: Draws,
}

impl Observation {
    /// Checks that the fields fit each other; policies that are called directly may rely on it.
    ///
    /// # Errors
    /// [`PolicyError::Observation`] names the first bad field.
    pub fn check(&self) -> Result<(), PolicyError> {
        let bad = |field, problem: String| Err(PolicyError::Observation { field, problem });
        if self.frames.len() != self.cameras.len() {
            return bad("frames", format!("holds {} cameras, {} calibrated", self.frames.len(), self.cameras.len()));
        }
        for (frames, camera) in self.frames.iter().zip(&self.cameras) {
            if frames.is_empty() {
                return bad("frames", format!("holds no frame of camera {:?}", camera.id.as_str()));
            }
        }
        if self.horizon_ticks == 0 || self.horizon_ticks > MAX_HORIZON_TICKS {
            return bad("horizon_ticks", format!("is {}, it must be 1 to {MAX_HORIZON_TICKS}", self.horizon_ticks));
        }
        if self.dt.0 <= 0 {
            return bad("dt", format!("is {} s, it must be positive", self.dt.secs()));
        }
        if !self.ego.is_finite() {
            return bad("ego", format!("is not finite: {:?}", self.ego));
        }
        Ok(())
    }
}

/// What only a privileged policy sees: the truth.
#[derive(Debug, Clone)]
pub struct PrivilegedView {
    /// The scenario with its map, its route and its recorded tracks.
    pub scene: Arc<Scene>,
    /// The tick of now.
    pub tick: Tick,
    /// The true state of the ego.
    pub ego: EgoState,
    /// The world as it goes; only for policies whose [`ds_world::Anchor`] sees it live.
    pub live: Option<Live>,
}

/// The live world with all agents.
#[derive(Debug, Clone, Default)]
pub struct Live {
    /// Its states of the last second, oldest first, that of now last.
    pub states: Vec<WorldState>,
    /// The simulator's snapshot of now, from which a copy goes on to the bit.
    pub snapshot: Vec<u8>,
}

impl PrivilegedView {
    /// Returns the answer of a policy that drives through world poses, one a tick from the next.
    ///
    /// # Errors
    /// [`PolicyError::Plan`] if they are no plan.
    pub fn answer(&self, name: &'static str, driven: &[PoseSe2], dt: SimTime) -> Result<PolicyAnswer, PolicyError> {
        let poses: Vec<PoseSe2> = driven.iter().map(|pose| self.ego.pose.relative(pose)).collect();
        Ok(PolicyAnswer::single(evenly_spaced(name, &poses, dt)?))
    }

    /// Returns the live world.
    ///
    /// # Errors
    /// [`PolicyError::NeedsPrivilege`] if it was not given.
    pub fn live(&self, name: &'static str) -> Result<(&Live, &WorldState), PolicyError> {
        let live = self.live.as_ref().and_then(|live| Some((live, live.states.last()?)));
        live.ok_or(PolicyError::NeedsPrivilege { name })
    }
}

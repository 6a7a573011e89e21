//! A moment that policies plan at: what they are told besides a frame, the car's own motion and the route command there.
//!
//! The command is that of the log at the moment's tick. A plan depends on nothing but moment, policy and frame, so that plans
//! of two frames of one moment differ by what the frames show alone.

use std::sync::Arc;

use ds_policy::{EgoView, Observation};
use ds_raster::RgbImage;
use ds_sim::{SimConfig, Simulation};
use ds_space::{CameraModel, Draws, SimTime};
use ds_world::{RouteCommand, Scene, Trajectory, WorldState};

use super::panel::Member;
use crate::error::EvaluationError;

/// H, in ticks.
const HORIZON_TICKS: u32 = 80;

/// A moment of a scenario.
pub(crate) struct Moment {
    scene: Arc<Scene>,
    /// The state of the world that frames show.
    pub(crate) world: WorldState,
    command: RouteCommand,
}

impl Moment {
    /// Takes the moment of a world of a scenario.
    ///
    /// # Errors
    /// If the scenario cannot be simulated there.
    pub(crate) fn new(scene: &Arc<Scene>, world: WorldState) -> Result<Self, EvaluationError> {
        let config = SimConfig { agents: None, ..SimConfig::default() };
        let simulation = Simulation::new(Arc::clone(scene), config, world.tick).map_err(|error| {
            EvaluationError::config("scenarios", format!("{} cannot be simulated: {error}", scene.name))
        })?;
        Ok(Self { scene: Arc::clone(scene), command: simulation.route_command(), world })
    }

    /// Returns what a policy plans on a frame of this moment.
    ///
    /// # Errors
    /// If it cannot plan on the frame.
    pub(crate) fn plan(
        &self,
        member: &mut Member,
        camera: &CameraModel,
        frame: &RgbImage,
    ) -> Result<Trajectory, EvaluationError> {
        let tick = self.world.tick;
        let observation = Observation {
            frames: vec![vec![frame.clone()]],
            cameras: vec![camera.clone()],
            ego: EgoView::of(&[self.world.ego]),
            command: self.command,
            stamps: vec![SimTime::at(tick, self.scene.dt)],
            horizon_ticks: HORIZON_TICKS,
            dt: self.scene.dt,
            draw: Draws::new(&self.scene.digest, "study plan", &[u64::from(tick.0)]),
        };
        let answer = member.policy.plan(&observation, None).map_err(|source| EvaluationError::Policy {
            policy: member.name.clone(),
            frames: self.scene.name.clone(),
            source,
        })?;
        Ok(answer.trajectory)
    }
}

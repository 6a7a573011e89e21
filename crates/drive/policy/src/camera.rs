//! The end-to-end policy: the newest frame of the forward camera, the speed and the route command to a trajectory.
//!
//! The frame is first brought to one fixed camera ([`eye`]); a small network (`ds_graph::planner`) proposes a few
//! trajectories of eight poses at 0.5 s with a score each ([`proposals`]); the best one is the answer, continued beyond
//! 4 s at constant speed and curvature. Of the K frames only the newest is used, and of the ego's motion only the
//! speed: a network that also sees how the car moved learns to repeat it.

pub mod eye;
pub mod proposals;

use ds_graph::planner::{CONTEXT, Planner, PlannerSize};
use ds_nn::{Array, Weights};
use ds_raster::RgbImage;
use ds_space::CameraModel;

use crate::error::PolicyError;
use crate::observation::{Observation, PrivilegedView};
use crate::plan::PolicyAnswer;
use crate::{Context, Grid, Policy, Restart};
use eye::Eye;
use proposals::{OUTPUTS, STATE, decode, state_of};

/// The policy's name.
pub const NAME: &str = "camera";

/// The sizes of the policy's network.
pub const SIZE: PlannerSize = PlannerSize { state: STATE, outputs: OUTPUTS };

/// Drives by what the forward camera shows.
pub struct CameraPolicy {
    network: Planner,
    eye: Eye,
}

impl CameraPolicy {
    /// Makes the policy of weights.
    ///
    /// # Errors
    /// If a weight is missing, surplus, not finite or has a wrong shape.
    pub fn new(weights: &Weights) -> Result<Self, ds_nn::WeightsError> {
        Ok(Self { network: Planner::new(SIZE, weights)?, eye: Eye::default() })
    }
}

impl Policy for CameraPolicy {
    fn name(&self) -> &str {
        NAME
    }

    fn privileged(&self) -> bool {
        false
    }

    fn plan(&mut self, observation: &Observation, _: Option<&PrivilegedView>) -> Result<PolicyAnswer, PolicyError> {
        observation.check()?;
        let images = self.eye.newest(observation)?;
        let speed_mps = observation.ego.speed_mps;
        let state = Array::new(&[1, STATE], state_of(speed_mps, observation.command).to_vec());
        let outputs = self.network.answer(&images, &state);
        let candidates = decode(speed_mps, outputs.values());
        proposals::answer(NAME, observation, &candidates)
    }

    /// The squeezed map that the hidden layers read, 6×10 places of 24 channels: the deepest features that depend on the
    /// frame alone.
    fn context(&mut self, cameras: &[CameraModel], frames: &[RgbImage]) -> Result<Option<Context>, PolicyError> {
        let images = self.eye.images(cameras.iter().zip(frames))?;
        let [rows, columns, channels] = CONTEXT;
        let tokens = Array::new(&[rows * columns, channels], self.network.context(&images).into_values());
        Ok(Some(Context { tokens, grid: Some(Grid::Picture([rows, columns])) }))
    }

    fn restart(&self) -> Restart {
        Restart::Stateless
    }
}

#[cfg(test)]
mod tests;

//! The end-to-end policy: the newest frame of the forward camera, the speed and the route command to a trajectory.
//!
//! The frame is first brought to one fixed camera ([`eye`]); a small network (`ds_graph::planner`) proposes a few
//! trajectories of eight poses at 0.5 s with a score each ([`proposals`]); the best one is the answer, continued beyond
//! 4 s at constant speed and curvature. Of the K frames only the newest is used, and of the ego's motion only the
//! speed: a network that also sees how the car moved learns to repeat it.

pub mod eye;
pub mod proposals;

use std::path::Path;

use ds_graph::planner::{CONTEXT, HEIGHT_PX, Planner, PlannerSize, WIDTH_PX};
use ds_nn::safetensors::WeightsFile;
use ds_nn::{Array, Weights};
use ds_raster::RgbImage;
use ds_space::CameraModel;
use ds_world::Proposal;

use crate::error::PolicyError;
use crate::observation::{Observation, PrivilegedView};
use crate::plan::{PolicyAnswer, evenly_spaced};
use crate::{Context, Policy, Restart};
use eye::Eye;
use proposals::{OUTPUTS, STATE, decode, poses_at_ticks, state_of};

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

    /// Makes the policy of a safetensors file.
    ///
    /// # Errors
    /// [`PolicyError::Weights`] names the file and what is wrong with it.
    pub fn load(path: &Path) -> Result<Self, PolicyError> {
        let refuse = |source| PolicyError::Weights { path: path.display().to_string(), source };
        let file = WeightsFile::read(path).map_err(|error| refuse(error.into()))?;
        Self::new(&file.weights).map_err(|error| refuse(error.into()))
    }
}

impl CameraPolicy {
    /// Returns the forward camera's frame as the network sees it: [1, 96, 160, 3].
    fn images<'a>(
        &mut self,
        pairs: impl Iterator<Item = (&'a CameraModel, &'a RgbImage)>,
    ) -> Result<Array, PolicyError> {
        let (camera, frame) = forward_frame(pairs)?;
        let seen = self.eye.look(camera, frame);
        let mut pixels = Vec::with_capacity(seen.rgb().len());
        normalise_into(seen.rgb(), &mut pixels);
        Ok(Array::new(&[1, HEIGHT_PX, WIDTH_PX, 3], pixels))
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
        let newest = observation.frames.iter().map(|frames| frames.last().expect("the observation was checked"));
        let images = self.images(observation.cameras.iter().zip(newest))?;
        let speed_mps = observation.ego.speed_mps;
        let state = Array::new(&[1, STATE], state_of(speed_mps, observation.command).to_vec());
        let outputs = self.network.answer(&images, &state);
        let candidates = decode(speed_mps, outputs.values());
        let mut proposals = Vec::with_capacity(candidates.len());
        for candidate in &candidates {
            let poses = poses_at_ticks(speed_mps, &candidate.knots, observation.horizon_ticks, observation.dt);
            let trajectory = evenly_spaced(NAME, &poses, observation.dt)?;
            proposals.push(Proposal { trajectory, score: candidate.probability });
        }
        let best = proposals.iter().reduce(|best, next| if next.score > best.score { next } else { best });
        let trajectory = best.expect("the network always makes proposals").trajectory.clone();
        Ok(PolicyAnswer { trajectory, proposals })
    }

    /// The squeezed map that the hidden layers read, 6×10 places of 24 channels: the deepest features that depend on the
    /// frame alone.
    fn context(&mut self, cameras: &[CameraModel], frames: &[RgbImage]) -> Result<Option<Context>, PolicyError> {
        let images = self.images(cameras.iter().zip(frames))?;
        let [rows, columns, channels] = CONTEXT;
        let tokens = Array::new(&[rows * columns, channels], self.network.context(&images).into_values());
        Ok(Some(Context { tokens, grid: Some([rows, columns]) }))
    }

    fn restart(&self) -> Restart {
        Restart::Stateless
    }
}

/// Appends 8-bit values as the network sees them.
pub fn normalise_into(rgb: &[u8], pixels: &mut Vec<f32>) {
    pixels.extend(rgb.iter().map(|value| (f32::from(*value) * (1.0 / 255.0) - 0.45) * 4.0));
}

/// Returns the frame of the camera that looks most nearly ahead.
fn forward_frame<'a>(
    pairs: impl Iterator<Item = (&'a CameraModel, &'a RgbImage)>,
) -> Result<(&'a CameraModel, &'a RgbImage), PolicyError> {
    let ahead = |camera: &CameraModel| (camera.rig_from_camera.rotation * ds_space::DVec3::Z).x;
    let best = pairs.reduce(|best, next| if ahead(next.0) > ahead(best.0) { next } else { best });
    let (camera, frame) = best.ok_or(PolicyError::Observation { field: "cameras", problem: "is empty".into() })?;
    if ahead(camera) < 0.7 {
        let problem = format!("has no camera that looks ahead; the nearest is {:?}", camera.id.as_str());
        return Err(PolicyError::Observation { field: "cameras", problem });
    }
    Ok((camera, frame))
}

#[cfg(test)]
mod tests;

//! A policy of one's own: a network of others, wrapped as its manifest says.
//!
//! Frames, motion and command become the inputs that [`ds_onnx::Manifest`] names, and its outputs poses of the rear axle in
//! the rig frame of now: metres and radians, x forward, y left. A plan is handed on as the network gave it, pose by pose;
//! where it ends before the asked horizon it goes on as the manifest says.

mod calibration;

use std::path::{Path, PathBuf};

use ds_nn::Array;
use ds_onnx::manifest::{Angle, Axes, Beyond, Camera, Direction, ImageSection, PlanSection, StateField};
use ds_onnx::{Manifest, Network};
use ds_raster::RgbImage;
use ds_space::{CameraModel, DVec2, Digest, PoseSe2, SimTime};
use ds_world::{Proposal, RouteCommand, Trajectory, TrajectoryPoint};

use crate::builtin::is_builtin;
use crate::camera::eye::Eye;
use crate::camera::proposals::continued;
use crate::error::PolicyError;
use crate::observation::{EgoView, Observation, PrivilegedView};
use crate::plan::PolicyAnswer;
use crate::{Context, Policy, Restart};

/// Shorter steps than this do not say where a car points, in metres.
const STEP_M: f64 = 0.02;

/// Drives by a network of others; copies share it.
#[derive(Debug, Clone)]
pub struct Own {
    manifest: Manifest,
    network: Network,
    digest: Digest,
    eye: Eye,
}

impl Own {
    /// Returns the manifest that a policy is named by, if it is: a file `.toml` in a policy's place.
    #[must_use]
    pub fn named(policy: &str) -> Option<PathBuf> {
        let path = Path::new(policy);
        path.extension().is_some_and(|extension| extension == "toml").then(|| path.to_path_buf())
    }

    /// Returns the name that a manifest gives its policy; the network is not touched.
    ///
    /// # Errors
    /// If the manifest is refused.
    pub fn name_in(manifest: &Path) -> Result<String, PolicyError> {
        Ok(Manifest::read(manifest)?.policy.name)
    }

    /// Reads a manifest and its network.
    ///
    /// # Errors
    /// [`PolicyError::Own`] names what is wrong with either, [`PolicyError::Taken`] a built-in policy of the same name.
    pub fn read(manifest: &Path) -> Result<Self, PolicyError> {
        let manifest = Manifest::read(manifest)?;
        if is_builtin(&manifest.policy.name) {
            return Err(PolicyError::Taken { name: manifest.policy.name, by: "a built-in policy" });
        }
        let network = manifest.network()?;
        let digest = manifest.digest(&network);
        Ok(Self { manifest, network, digest, eye: Eye::default() })
    }

    /// Returns the digest of manifest and network.
    #[must_use]
    pub fn digest(&self) -> &Digest {
        &self.digest
    }

    /// Returns how many frames the network sees.
    #[must_use]
    pub fn history(&self) -> u32 {
        self.manifest.image.as_ref().map_or(1, |image| image.history)
    }

    /// Says whether the manifest names what the network attends to.
    #[must_use]
    pub fn has_feature(&self) -> bool {
        self.manifest.feature.is_some()
    }

    /// Makes the inputs of the network.
    fn inputs(&mut self, views: &Views<'_>, ego: &EgoView, command: RouteCommand) -> Result<Vec<Array>, PolicyError> {
        let mut inputs = Vec::new();
        if let Some(image) = &self.manifest.image {
            inputs.push(image.array(&frames(image, &mut self.eye, views)?));
        }
        if let Some(state) = &self.manifest.state {
            let scales = state.scale.iter().copied().chain(std::iter::repeat(1.0));
            let values = state.fields.iter().zip(scales).map(|(field, scale)| scale * number(*field, ego, command));
            inputs.push(Array::new(&[1, state.fields.len()], values.collect()));
        }
        if let Some(section) = &self.manifest.command {
            let values = section.one_hot.iter().map(|direction| f32::from(u8::from(is(*direction, command))));
            inputs.push(Array::new(&[1, section.one_hot.len()], values.collect()));
        }
        if let (Some(section), Some(image)) = (&self.manifest.calibration, &self.manifest.image) {
            inputs.extend(calibration::arrays(section, &calibration::seen(image, views)?));
        }
        Ok(inputs)
    }

    fn inputs_of(&mut self, observation: &Observation) -> Result<Vec<Array>, PolicyError> {
        observation.check()?;
        let views: Vec<_> = observation.cameras.iter().zip(observation.frames.iter().map(Vec::as_slice)).collect();
        self.inputs(&views, &observation.ego, observation.command)
    }

    /// Returns the feature among the outputs, the last one, if the manifest names it.
    fn told(&self, outputs: Vec<Array>) -> Result<Option<Context>, PolicyError> {
        let Some(feature) = outputs.into_iter().next_back().filter(|_| self.has_feature()) else { return Ok(None) };
        if let Some(value) = feature.values().iter().find(|value| !value.is_finite()) {
            let problem = format!("gives a feature that holds {value}");
            return Err(PolicyError::Answer { name: self.manifest.policy.name.clone(), problem });
        }
        let channels = columns(&feature).max(1);
        let tokens = feature.values().len() / channels;
        Ok(Some(Context { tokens: Array::new(&[tokens, channels], feature.into_values()), grid: None }))
    }

    fn trajectory(&self, poses: &[f32], columns: usize, observation: &Observation) -> Result<Trajectory, PolicyError> {
        let plan = &self.manifest.plan;
        let horizon = SimTime(observation.dt.0 * i64::from(observation.horizon_ticks));
        let points = points(plan, &poses_of(plan, poses, columns), horizon);
        Trajectory::new(points).map_err(|source| PolicyError::Plan { name: self.manifest.policy.name.clone(), source })
    }
}

impl Policy for Own {
    fn name(&self) -> &str {
        &self.manifest.policy.name
    }

    fn privileged(&self) -> bool {
        false
    }

    fn plan(&mut self, observation: &Observation, _: Option<&PrivilegedView>) -> Result<PolicyAnswer, PolicyError> {
        let inputs = self.inputs_of(observation)?;
        let outputs = self.network.answer(&inputs)?;
        let trajectory = self.trajectory(outputs[0].values(), columns(&outputs[0]), observation)?;
        let mut proposals = Vec::new();
        if self.manifest.proposals.is_some() {
            let (poses, scores) = (&outputs[1], &outputs[2]);
            let size = poses.values().len() / scores.values().len();
            for (poses_of_one, score) in poses.values().chunks_exact(size).zip(scores.values()) {
                if !score.is_finite() {
                    let problem = format!("gives a score of {score}");
                    return Err(PolicyError::Answer { name: self.manifest.policy.name.clone(), problem });
                }
                let trajectory = self.trajectory(poses_of_one, columns(poses), observation)?;
                proposals.push(Proposal { trajectory, score: f64::from(*score) });
            }
        }
        let context = self.told(outputs)?;
        Ok(PolicyAnswer { trajectory, proposals, context })
    }

    /// Asks the network for a batch, where it takes one of that size.
    fn plan_together(&mut self, observations: &[&Observation]) -> Result<Option<Vec<PolicyAnswer>>, PolicyError> {
        let each = observations.iter().map(|seen| self.inputs_of(seen)).collect::<Result<Vec<_>, _>>()?;
        let Ok(network) = self.manifest.network_of(observations.len()) else { return Ok(None) };
        let places = each.first().map_or(0, Vec::len);
        let batch: Vec<Array> = (0..places).map(|place| stacked(each.iter().map(|inputs| &inputs[place]))).collect();
        let Ok(mut answers) = network.answer(&batch) else { return Ok(None) };
        let answer = answers.swap_remove(0);
        let size = answer.values().len() / observations.len();
        if size != self.network.outputs()[0].iter().product::<usize>() {
            return Ok(None);
        }
        let rows = answer.values().chunks_exact(size).zip(observations);
        let plans = rows.map(|(row, seen)| Ok(PolicyAnswer::single(self.trajectory(row, columns(&answer), seen)?)));
        plans.collect::<Result<_, PolicyError>>().map(Some)
    }

    /// The feature that the manifest names; the state is that of a car that stands still.
    fn context(&mut self, cameras: &[CameraModel], frames: &[RgbImage]) -> Result<Option<Context>, PolicyError> {
        if !self.has_feature() {
            return Ok(None);
        }
        let views: Vec<_> = cameras.iter().zip(frames.iter().map(std::slice::from_ref)).collect();
        let inputs = self.inputs(&views, &EgoView::default(), RouteCommand::Straight)?;
        self.told(self.network.answer(&inputs)?)
    }

    fn restart(&self) -> Restart {
        Restart::Stateless
    }
}

fn columns(output: &Array) -> usize {
    output.shape().last().copied().unwrap_or(1)
}

/// Puts rows below each other.
fn stacked<'a>(rows: impl Iterator<Item = &'a Array>) -> Array {
    let (mut shape, mut values) = (Vec::new(), Vec::new());
    for row in rows {
        let rows_before = shape.first().copied().unwrap_or_default();
        shape = row.shape().to_vec();
        shape[0] += rows_before;
        values.extend_from_slice(row.values());
    }
    Array::new(&shape, values)
}

/// Cameras with their frames, oldest first.
type Views<'a> = [(&'a CameraModel, &'a [RgbImage])];

/// Returns the frames that a network sees, oldest first, the oldest again where there are too few.
fn frames(image: &ImageSection, eye: &mut Eye, views: &Views<'_>) -> Result<Vec<RgbImage>, PolicyError> {
    let seen = views.iter().map(|(_, frames)| frames.len()).min().unwrap_or_default();
    let wanted = image.history as usize;
    let mut shown = Vec::with_capacity(wanted);
    for place in 0..wanted {
        // The newest comes last.
        let index = (seen + place).saturating_sub(wanted).min(seen.saturating_sub(1));
        let frame = match &image.camera {
            Camera::Known => eye.ahead(views.iter().map(|(camera, frames)| (*camera, &frames[index])))?,
            Camera::Raw(id) => raw(id, views)?.1[index].clone(),
        };
        shown.push(image.sized(&frame));
    }
    Ok(shown)
}

/// Returns a camera by its name, with its frames.
fn raw<'a>(id: &str, views: &Views<'a>) -> Result<(&'a CameraModel, &'a [RgbImage]), PolicyError> {
    views.iter().find(|(camera, _)| camera.id.as_str() == id).copied().ok_or_else(|| {
        let known: Vec<&str> = views.iter().map(|(camera, _)| camera.id.as_str()).collect();
        let problem = format!("has no camera {id:?}, which the manifest names; there are {}", known.join(", "));
        PolicyError::Observation { field: "cameras", problem }
    })
}

#[expect(clippy::cast_possible_truncation, reason = "inputs are single precision")]
fn number(field: StateField, ego: &EgoView, command: RouteCommand) -> f32 {
    let says = |wanted| f64::from(u8::from(command == wanted));
    let number = match field {
        StateField::SpeedMps => ego.speed_mps,
        StateField::AccelerationForwardMps2 => ego.acceleration_mps2.x,
        StateField::AccelerationLeftMps2 => ego.acceleration_mps2.y,
        StateField::YawRateRadps => ego.yaw_rate_radps,
        StateField::SteeringRad => ego.steering_rad,
        StateField::CommandLeft => says(RouteCommand::Left),
        StateField::CommandStraight => says(RouteCommand::Straight),
        StateField::CommandRight => says(RouteCommand::Right),
        StateField::Zero => 0.0,
    };
    number as f32
}

fn is(direction: Direction, command: RouteCommand) -> bool {
    match direction {
        Direction::Left => command == RouteCommand::Left,
        Direction::Straight => command == RouteCommand::Straight,
        Direction::Right => command == RouteCommand::Right,
        Direction::Unknown => false,
    }
}

/// Returns the poses of a plan's numbers, in the rig frame of now.
fn poses_of(plan: &PlanSection, numbers: &[f32], columns: usize) -> Vec<PoseSe2> {
    let ahead_m = plan.origin_ahead_m;
    let (mut before, mut pointing) = (DVec2::new(ahead_m, 0.0), 0.0);
    let pose = |numbers: &[f32]| {
        let [a, b] = [0, 1].map(|column| f64::from(numbers[column]));
        let (position, hand) = match plan.axes {
            Axes::ForwardLeft => (DVec2::new(a, b), 1.0),
            Axes::ForwardRight => (DVec2::new(a, -b), -1.0),
            Axes::LeftForward => (DVec2::new(b, a), 1.0),
            Axes::RightForward => (DVec2::new(b, -a), -1.0),
        };
        let position = position + DVec2::new(ahead_m, 0.0);
        let step = position - before;
        let heading_rad = match numbers.get(2) {
            Some(third) if plan.angle == Angle::Degrees => hand * f64::from(*third).to_radians(),
            Some(third) => hand * f64::from(*third),
            None if step.length() > STEP_M => step.y.atan2(step.x),
            None => pointing,
        };
        (before, pointing) = (position, heading_rad);
        let axle = position - ahead_m * DVec2::from_angle(heading_rad);
        // As given: a heading that is wrapped would hide a wrong unit.
        PoseSe2 { position: axle, heading_rad }
    };
    numbers.chunks_exact(columns).map(pose).collect()
}

/// Returns the points of a plan, gone on to the horizon.
fn points(plan: &PlanSection, poses: &[PoseSe2], horizon: SimTime) -> Vec<TrajectoryPoint> {
    let spacing = SimTime::from_secs(plan.spacing_s);
    // A pose at now says nothing.
    let ahead = if plan.first_s == 0.0 { &poses[1.min(poses.len())..] } else { poses };
    let point = |(index, pose): (i64, &PoseSe2)| TrajectoryPoint { after: SimTime(spacing.0 * index), pose: *pose };
    let mut points: Vec<TrajectoryPoint> = (1..).zip(ahead).map(point).collect();
    let (Some(last), Beyond::Curvature) = (points.last().copied(), plan.beyond) else { return points };
    let before = points.len().checked_sub(2).map_or(PoseSe2::default(), |index| points[index].pose);
    let steps = (1..).map(|step| SimTime(spacing.0 * step));
    let due = steps.take_while(|beyond| last.after + *beyond < horizon + spacing);
    points.extend(due.map(|beyond| TrajectoryPoint {
        after: last.after + beyond,
        pose: continued(&before, &last.pose, plan.spacing_s, beyond.secs()),
    }));
    points
}

#[cfg(test)]
mod tests;

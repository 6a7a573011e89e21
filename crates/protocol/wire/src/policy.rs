//! The outside contract as values: what a guest policy is shown and what it answers.
//!
//! Poses are given in Start, the rig at the session's first observation, and times count from there; nothing names
//! the episode, the scenario or the world. Messages from a guest are bounded before they are decoded.

use bytes::Bytes;
use ds_raster::{Encoding, RgbImage};
use ds_space::{CameraId, CameraModel, DVec2, DVec3, Intrinsics, Pose, PoseSe2, SimTime};
use ds_topic::Plan;
use ds_topic::body::Tensor;
use ds_world::{EgoState, Proposal, RouteCommand, TrajectoryPoint};
use prost::Message;

use crate::body::decode;
use crate::error::{FieldError, WireError};
use crate::field::{checked, choice, enumeration, list, number, part, positive, text, whole};
use crate::geometry::{MAX_SIDE_PX, rotation};
use crate::plan::MAX_CONTEXT;
use crate::policy_v1 as p1;
use crate::tally::Limit;
use crate::v1;

/// The version of the outside contract.
pub const CONTRACT_VERSION: u32 = 1;
/// The longest observation, in bytes.
pub const MAX_OBSERVATION_BYTES: usize = 64 << 20;
/// The longest message from a guest, in bytes.
pub const MAX_ANSWER_BYTES: usize = 1 << 20;
/// The most proposals of a guest's plan.
pub const MAX_PROPOSALS: usize = 64;
/// The most images of a camera, and the most ego estimates.
pub const MAX_HISTORY: usize = 256;
/// The longest name or reason, in bytes.
pub const MAX_TEXT_BYTES: usize = 256;

/// A message of the outside contract.
pub trait PolicyMessage: Sized {
    /// Writes the message.
    fn to_bytes(&self) -> Bytes;

    /// Reads the message.
    ///
    /// # Errors
    /// [`WireError`] names message, field and value.
    fn from_bytes(bytes: &[u8]) -> Result<Self, WireError>;
}

/// A camera image with its time since the session's start.
#[derive(Debug, Clone, PartialEq)]
pub struct StampedImage {
    /// When it was taken.
    pub time: SimTime,
    /// The pixels.
    pub image: RgbImage,
}

/// A camera with its last images, oldest first.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraView {
    /// Lens and mounting.
    pub camera: CameraModel,
    /// The last images.
    pub images: Vec<StampedImage>,
}

/// An ego estimate with its time since the session's start; the pose is given in Start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampedEgo {
    /// When it held.
    pub time: SimTime,
    /// The estimate; `steering_rate_radps` is not shown and reads 0.
    pub state: EgoState,
}

/// What the policy sees; asks for a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Observation {
    /// Counts the observations of the session, from 0.
    pub sequence: u64,
    /// Time since the session's start.
    pub time: SimTime,
    /// The cameras.
    pub cameras: Vec<CameraView>,
    /// Ego estimates, oldest first, the present one last.
    pub ego: Vec<StampedEgo>,
    /// The route command.
    pub command: RouteCommand,
    /// How far the plan should reach.
    pub horizon: SimTime,
    /// Spacing of poses that the simulator works with.
    pub step: SimTime,
    /// Time for the answer, in milliseconds.
    pub deadline_millis: u64,
    /// How images travel: none or PNG.
    pub encoding: Encoding,
}

/// A session begins.
#[derive(Debug, Clone, PartialEq)]
pub struct SessionHello {
    /// The rig's cameras.
    pub cameras: Vec<CameraModel>,
    /// Images per camera in each observation.
    pub history: u32,
    /// How far plans should reach.
    pub horizon: SimTime,
    /// Spacing of poses that the simulator works with.
    pub step: SimTime,
    /// Time for each answer, in milliseconds.
    pub deadline_millis: u64,
}

/// The policy is there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PolicyHello {
    /// What the policy calls itself.
    pub name: String,
}

/// The policy's answer.
#[derive(Debug, Clone, PartialEq)]
pub struct PolicyPlan {
    /// The observation that is answered.
    pub for_sequence: u64,
    /// Trajectory and proposals, in the rig frame at the observation.
    pub plan: Plan,
}

/// The session is over.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SessionGoodbye {
    /// Why.
    pub reason: String,
}

/// The policy ends the session.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PolicyGoodbye {
    /// Why.
    pub reason: String,
}

enumeration!(p1::Command, RouteCommand, { Straight = Straight, Left = Left, Right = Right });

impl From<&PoseSe2> for p1::Pose {
    fn from(value: &PoseSe2) -> Self {
        Self { x_m: Some(value.position.x), y_m: Some(value.position.y), heading_rad: Some(value.heading_rad) }
    }
}

impl TryFrom<p1::Pose> for PoseSe2 {
    type Error = FieldError;
    fn try_from(message: p1::Pose) -> Result<Self, FieldError> {
        let heading_rad = number("heading_rad", message.heading_rad)?;
        Ok(Self::new(number("x_m", message.x_m)?, number("y_m", message.y_m)?, heading_rad))
    }
}

impl From<&CameraModel> for p1::Calibration {
    fn from(value: &CameraModel) -> Self {
        let (lens, mount) = (&value.intrinsics, &value.rig_from_camera);
        Self {
            camera: value.id.as_str().to_owned(),
            width_px: lens.width_px,
            height_px: lens.height_px,
            fx_px: Some(lens.fx_px),
            fy_px: Some(lens.fy_px),
            cx_px: Some(lens.cx_px),
            cy_px: Some(lens.cy_px),
            k1: Some(lens.k1),
            k2: Some(lens.k2),
            rig_from_camera_qx: Some(mount.rotation.x),
            rig_from_camera_qy: Some(mount.rotation.y),
            rig_from_camera_qz: Some(mount.rotation.z),
            rig_from_camera_qw: Some(mount.rotation.w),
            position_in_rig_x_m: Some(mount.translation.x),
            position_in_rig_y_m: Some(mount.translation.y),
            position_in_rig_z_m: Some(mount.translation.z),
        }
    }
}

impl TryFrom<p1::Calibration> for CameraModel {
    type Error = FieldError;
    fn try_from(message: p1::Calibration) -> Result<Self, FieldError> {
        let quaternion = [
            number("rig_from_camera_qx", message.rig_from_camera_qx)?,
            number("rig_from_camera_qy", message.rig_from_camera_qy)?,
            number("rig_from_camera_qz", message.rig_from_camera_qz)?,
            number("rig_from_camera_qw", message.rig_from_camera_qw)?,
        ];
        let position = DVec3::new(
            number("position_in_rig_x_m", message.position_in_rig_x_m)?,
            number("position_in_rig_y_m", message.position_in_rig_y_m)?,
            number("position_in_rig_z_m", message.position_in_rig_z_m)?,
        );
        Ok(Self {
            id: checked("camera", CameraId::new(&message.camera))?,
            intrinsics: Intrinsics {
                width_px: whole("width_px", message.width_px, 1, MAX_SIDE_PX)?,
                height_px: whole("height_px", message.height_px, 1, MAX_SIDE_PX)?,
                fx_px: positive("fx_px", message.fx_px)?,
                fy_px: positive("fy_px", message.fy_px)?,
                cx_px: number("cx_px", message.cx_px)?,
                cy_px: number("cy_px", message.cy_px)?,
                k1: number("k1", message.k1)?,
                k2: number("k2", message.k2)?,
            },
            rig_from_camera: Pose::new(rotation("rig_from_camera_qw", quaternion)?, position),
        })
    }
}

fn encoding_of(message: &p1::Image) -> Result<Encoding, FieldError> {
    match p1::Encoding::try_from(message.encoding) {
        Ok(p1::Encoding::Raw) => Ok(Encoding::None),
        Ok(p1::Encoding::Png) => Ok(Encoding::Png),
        _ => Err(FieldError::new("encoding", format!("is {}, no known value", message.encoding))),
    }
}

fn image_message(value: &StampedImage, encoding: Encoding) -> p1::Image {
    let sent = crate::image::to_message(&value.image, encoding);
    let encoding = if encoding == Encoding::Png { p1::Encoding::Png } else { p1::Encoding::Raw };
    p1::Image {
        time_ns: value.time.0,
        width_px: sent.width_px,
        height_px: sent.height_px,
        encoding: encoding.into(),
        data: sent.data,
    }
}

impl TryFrom<p1::Image> for StampedImage {
    type Error = FieldError;
    fn try_from(message: p1::Image) -> Result<Self, FieldError> {
        let encoding = encoding_of(&message)?;
        crate::image::pixels(message.width_px, message.height_px)?;
        let image = RgbImage::decode(encoding, message.width_px, message.height_px, &message.data);
        Ok(Self { time: SimTime(message.time_ns), image: checked("data", image)? })
    }
}

impl TryFrom<p1::CameraView> for CameraView {
    type Error = FieldError;
    fn try_from(message: p1::CameraView) -> Result<Self, FieldError> {
        Ok(Self {
            camera: part("calibration", message.calibration)?,
            images: list("images", message.images, MAX_HISTORY)?,
        })
    }
}

impl From<&StampedEgo> for p1::Ego {
    fn from(value: &StampedEgo) -> Self {
        let state = &value.state;
        Self {
            time_ns: value.time.0,
            pose: Some((&state.pose).into()),
            velocity_x_mps: Some(state.velocity_mps.x),
            velocity_y_mps: Some(state.velocity_mps.y),
            yaw_rate_radps: Some(state.yaw_rate_radps),
            acceleration_x_mps2: Some(state.acceleration_mps2.x),
            acceleration_y_mps2: Some(state.acceleration_mps2.y),
            steering_rad: Some(state.steering_rad),
        }
    }
}

impl TryFrom<p1::Ego> for StampedEgo {
    type Error = FieldError;
    fn try_from(message: p1::Ego) -> Result<Self, FieldError> {
        let velocity_x_mps = number("velocity_x_mps", message.velocity_x_mps)?;
        let acceleration_x_mps2 = number("acceleration_x_mps2", message.acceleration_x_mps2)?;
        let state = EgoState {
            pose: part("pose", message.pose)?,
            velocity_mps: DVec2::new(velocity_x_mps, number("velocity_y_mps", message.velocity_y_mps)?),
            yaw_rate_radps: number("yaw_rate_radps", message.yaw_rate_radps)?,
            acceleration_mps2: DVec2::new(
                acceleration_x_mps2,
                number("acceleration_y_mps2", message.acceleration_y_mps2)?,
            ),
            steering_rad: number("steering_rad", message.steering_rad)?,
            steering_rate_radps: 0.0,
        };
        Ok(Self { time: SimTime(message.time_ns), state })
    }
}

const OBSERVATION_LIMITS: &[Limit] = &[
    Limit { path: &[3], field: "cameras", most: crate::scene::MAX_CAMERAS },
    Limit { path: &[3, 2], field: "cameras.images", most: 4 * MAX_HISTORY },
    Limit { path: &[4], field: "ego", most: MAX_HISTORY },
];

impl PolicyMessage for Observation {
    fn to_bytes(&self) -> Bytes {
        let view = |view: &CameraView| p1::CameraView {
            calibration: Some((&view.camera).into()),
            images: view.images.iter().map(|image| image_message(image, self.encoding)).collect(),
        };
        let message = p1::Observation {
            sequence: self.sequence,
            time_ns: self.time.0,
            cameras: self.cameras.iter().map(view).collect(),
            ego: self.ego.iter().map(Into::into).collect(),
            command: p1::Command::from(self.command).into(),
            horizon_ns: self.horizon.0,
            step_ns: self.step.0,
            deadline_millis: self.deadline_millis,
        };
        message.encode_to_vec().into()
    }

    fn from_bytes(bytes: &[u8]) -> Result<Self, WireError> {
        let message: p1::Observation = decode("observation", bytes, MAX_OBSERVATION_BYTES, OBSERVATION_LIMITS)?;
        observation(message).map_err(|error| error.of("observation"))
    }
}

fn observation(message: p1::Observation) -> Result<Observation, FieldError> {
    let images = message.cameras.iter().flat_map(|view| &view.images);
    let total: u64 = images.clone().map(|image| u64::from(image.width_px) * u64::from(image.height_px)).sum();
    if total > 4 * crate::image::MAX_PIXELS {
        return Err(FieldError::new(
            "cameras",
            format!("hold {total} pixels, the limit is {}", 4 * crate::image::MAX_PIXELS),
        ));
    }
    let encoding = images.clone().next().map(encoding_of).transpose()?.unwrap_or_default();
    Ok(Observation {
        sequence: message.sequence,
        time: SimTime(message.time_ns),
        cameras: list("cameras", message.cameras, crate::scene::MAX_CAMERAS)?,
        ego: list("ego", message.ego, MAX_HISTORY)?,
        command: choice::<p1::Command, _>("command", message.command)?,
        horizon: SimTime(message.horizon_ns),
        step: SimTime(message.step_ns),
        deadline_millis: message.deadline_millis,
        encoding,
    })
}

impl TryFrom<p1::PlanPose> for TrajectoryPoint {
    type Error = FieldError;
    fn try_from(message: p1::PlanPose) -> Result<Self, FieldError> {
        let given = message.pose.as_ref().and_then(|pose| pose.heading_rad);
        let pose: PoseSe2 = part("pose", message.pose)?;
        // As given: a heading that is wrapped would hide a wrong unit.
        let heading_rad = given.unwrap_or(pose.heading_rad);
        Ok(Self { after: SimTime(message.after_ns), pose: PoseSe2 { heading_rad, ..pose } })
    }
}

fn poses(trajectory: &ds_world::Trajectory) -> Vec<p1::PlanPose> {
    let pose = |point: &TrajectoryPoint| p1::PlanPose { after_ns: point.after.0, pose: Some((&point.pose).into()) };
    trajectory.points().iter().map(pose).collect()
}

impl TryFrom<p1::PlanProposal> for Proposal {
    type Error = FieldError;
    fn try_from(message: p1::PlanProposal) -> Result<Self, FieldError> {
        let points = list("poses", message.poses, ds_world::trajectory::MAX_POINTS)?;
        Ok(Self { trajectory: crate::plan::trajectory(points)?, score: number("score", message.score)? })
    }
}

const PLAN_LIMITS: &[Limit] = &[
    Limit { path: &[2], field: "poses", most: ds_world::trajectory::MAX_POINTS },
    Limit { path: &[3], field: "proposals", most: MAX_PROPOSALS },
    Limit { path: &[3, 1], field: "proposals.poses", most: MAX_PROPOSALS * ds_world::trajectory::MAX_POINTS },
];

/// Takes what a policy attends to.
fn context(message: p1::PlanContext) -> Result<Tensor, FieldError> {
    let p1::PlanContext { channels, values } = message;
    let channels = whole("channels", channels, 1, MAX_CONTEXT as u32)?;
    let numbers = u32::try_from(values.len()).unwrap_or(u32::MAX);
    if !numbers.is_multiple_of(channels) {
        return Err(FieldError::new("values", format!("has {numbers} elements, no multiple of {channels} channels")));
    }
    crate::plan::context(v1::Tensor { shape: vec![numbers / channels, channels], values })
}

impl PolicyMessage for PolicyPlan {
    fn to_bytes(&self) -> Bytes {
        let proposal =
            |proposal: &Proposal| p1::PlanProposal { poses: poses(&proposal.trajectory), score: Some(proposal.score) };
        let message = p1::PolicyPlan {
            for_sequence: self.for_sequence,
            poses: poses(&self.plan.trajectory),
            proposals: self.plan.proposals.iter().map(proposal).collect(),
            context: self.plan.context.as_ref().map(|context| p1::PlanContext {
                channels: context.shape.last().copied().unwrap_or_default(),
                values: context.values.clone(),
            }),
        };
        message.encode_to_vec().into()
    }

    fn from_bytes(bytes: &[u8]) -> Result<Self, WireError> {
        let message: p1::PolicyPlan = decode("plan", bytes, MAX_ANSWER_BYTES, PLAN_LIMITS)?;
        let convert = |message: p1::PolicyPlan| {
            let points = list("poses", message.poses, ds_world::trajectory::MAX_POINTS)?;
            let trajectory = crate::plan::trajectory(points)?;
            let proposals = list("proposals", message.proposals, MAX_PROPOSALS)?;
            let context = message.context.map(context).transpose().map_err(|error| error.below("context"))?;
            Ok(Self {
                for_sequence: message.for_sequence,
                plan: Plan { trajectory, proposals, observed: None, answered: None, context },
            })
        };
        convert(message).map_err(|error: FieldError| error.of("plan"))
    }
}

const HELLO_LIMITS: &[Limit] = &[Limit { path: &[2], field: "cameras", most: crate::scene::MAX_CAMERAS }];

fn version(found: u32) -> Result<u32, FieldError> {
    whole("version", found, CONTRACT_VERSION, CONTRACT_VERSION)
}

impl PolicyMessage for SessionHello {
    fn to_bytes(&self) -> Bytes {
        let message = p1::SessionHello {
            version: CONTRACT_VERSION,
            cameras: self.cameras.iter().map(Into::into).collect(),
            history: self.history,
            horizon_ns: self.horizon.0,
            step_ns: self.step.0,
            deadline_millis: self.deadline_millis,
        };
        message.encode_to_vec().into()
    }

    fn from_bytes(bytes: &[u8]) -> Result<Self, WireError> {
        let message: p1::SessionHello = decode("hello", bytes, MAX_ANSWER_BYTES, HELLO_LIMITS)?;
        let convert = |message: p1::SessionHello| {
            version(message.version)?;
            Ok(Self {
                cameras: list("cameras", message.cameras, crate::scene::MAX_CAMERAS)?,
                history: message.history,
                horizon: SimTime(message.horizon_ns),
                step: SimTime(message.step_ns),
                deadline_millis: message.deadline_millis,
            })
        };
        convert(message).map_err(|error: FieldError| error.of("hello"))
    }
}

impl PolicyMessage for PolicyHello {
    fn to_bytes(&self) -> Bytes {
        p1::PolicyHello { version: CONTRACT_VERSION, name: self.name.clone() }.encode_to_vec().into()
    }

    fn from_bytes(bytes: &[u8]) -> Result<Self, WireError> {
        let message: p1::PolicyHello = decode("ready", bytes, MAX_ANSWER_BYTES, &[])?;
        let checked = version(message.version).and_then(|_| text("name", message.name, MAX_TEXT_BYTES));
        checked.map(|name| Self { name }).map_err(|error| error.of("ready"))
    }
}

macro_rules! goodbye {
    ($value:ident, $name:literal) => {
        impl PolicyMessage for $value {
            fn to_bytes(&self) -> Bytes {
                p1::$value { reason: self.reason.clone() }.encode_to_vec().into()
            }

            fn from_bytes(bytes: &[u8]) -> Result<Self, WireError> {
                let message: p1::$value = decode($name, bytes, MAX_ANSWER_BYTES, &[])?;
                let reason = text("reason", message.reason, MAX_TEXT_BYTES);
                reason.map(|reason| Self { reason }).map_err(|error| error.of($name))
            }
        }
    };
}

goodbye!(SessionGoodbye, "goodbye");
goodbye!(PolicyGoodbye, "leave");

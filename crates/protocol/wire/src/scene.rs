//! Topic `scene`: settings, scenario and first frames, complete enough that a replay needs nothing else.

use std::sync::Arc;

use ds_raster::Encoding;
use ds_space::{Intrinsics, SimTime};
use ds_topic::SceneMessage;
use ds_world::{Origin, Scene, Track, TrackPoint, VehicleParameters};

use crate::adversary::adversary;
use crate::error::FieldError;
use crate::field::{choice, digest, list, number, part, positive, text};
use crate::geometry::points;
use crate::image::{Lossless, MAX_PIXELS, pixels, to_message};
use crate::v1;
use crate::world::MAX_AGENTS;

/// The most ticks of a scenario.
pub const MAX_TICKS: usize = 20_000;
/// The most cameras of a rig.
pub const MAX_CAMERAS: usize = 64;
/// The longest name, in bytes.
pub const MAX_NAME_BYTES: usize = 256;
/// The longest prompt or origin, in bytes.
pub const MAX_TEXT_BYTES: usize = 4_096;

impl From<&VehicleParameters> for v1::VehicleParameters {
    fn from(value: &VehicleParameters) -> Self {
        Self {
            size: Some((&value.size).into()),
            wheel_base_m: Some(value.wheel_base_m),
            rear_axle_to_centre_m: Some(value.rear_axle_to_centre_m),
            max_steering_rad: Some(value.max_steering_rad),
            max_steering_rate_radps: Some(value.max_steering_rate_radps),
            max_acceleration_mps2: Some(value.max_acceleration_mps2),
            max_deceleration_mps2: Some(value.max_deceleration_mps2),
            mass_kg: Some(value.mass_kg),
        }
    }
}

impl TryFrom<v1::VehicleParameters> for VehicleParameters {
    type Error = FieldError;
    fn try_from(message: v1::VehicleParameters) -> Result<Self, FieldError> {
        Ok(Self {
            size: part("size", message.size)?,
            wheel_base_m: positive("wheel_base_m", message.wheel_base_m)?,
            rear_axle_to_centre_m: number("rear_axle_to_centre_m", message.rear_axle_to_centre_m)?,
            max_steering_rad: positive("max_steering_rad", message.max_steering_rad)?,
            max_steering_rate_radps: positive("max_steering_rate_radps", message.max_steering_rate_radps)?,
            max_acceleration_mps2: positive("max_acceleration_mps2", message.max_acceleration_mps2)?,
            max_deceleration_mps2: positive("max_deceleration_mps2", message.max_deceleration_mps2)?,
            mass_kg: positive("mass_kg", message.mass_kg)?,
        })
    }
}

impl From<&TrackPoint> for v1::TrackPoint {
    fn from(value: &TrackPoint) -> Self {
        Self { pose: Some((&value.pose).into()), z_m: Some(value.z_m), velocity_mps: Some(value.velocity_mps.into()) }
    }
}

impl TryFrom<v1::TrackPoint> for TrackPoint {
    type Error = FieldError;
    fn try_from(message: v1::TrackPoint) -> Result<Self, FieldError> {
        Ok(Self {
            pose: part("pose", message.pose)?,
            z_m: number("z_m", message.z_m)?,
            velocity_mps: part("velocity_mps", message.velocity_mps)?,
        })
    }
}

impl From<&Track> for v1::Track {
    fn from(value: &Track) -> Self {
        let tick = |point: &Option<TrackPoint>| v1::TrackTick { seen: point.as_ref().map(Into::into) };
        Self {
            name: value.name.clone(),
            agent_class: v1::AgentClass::from(value.class).into(),
            size: Some((&value.size).into()),
            ticks: value.points.iter().map(tick).collect(),
        }
    }
}

impl TryFrom<v1::Track> for Track {
    type Error = FieldError;
    fn try_from(message: v1::Track) -> Result<Self, FieldError> {
        Ok(Self {
            name: text("name", message.name, MAX_NAME_BYTES)?,
            class: choice::<v1::AgentClass, _>("agent_class", message.agent_class)?,
            size: part("size", message.size)?,
            points: track_points(message.ticks)?,
        })
    }
}

fn track_points(ticks: Vec<v1::TrackTick>) -> Result<Vec<Option<TrackPoint>>, FieldError> {
    if ticks.len() > MAX_TICKS {
        return Err(FieldError::new("ticks", format!("has {} elements, the limit is {MAX_TICKS}", ticks.len())));
    }
    let convert = |(index, tick): (usize, v1::TrackTick)| {
        let point = tick.seen.map(TrackPoint::try_from).transpose();
        point.map_err(|error| error.below("seen").within("ticks", index))
    };
    ticks.into_iter().enumerate().map(convert).collect()
}

impl From<&Scene> for v1::Scenario {
    fn from(value: &Scene) -> Self {
        Self {
            name: value.name.clone(),
            family: value.family.clone(),
            digest: value.digest.0.to_vec().into(),
            dt_ns: value.dt.0,
            map: Some((&value.map).into()),
            vehicle: Some((&value.vehicle).into()),
            ego_log: value.ego_log.iter().map(Into::into).collect(),
            route: Some(value.route.as_slice().into()),
            tracks: value.tracks.iter().map(Into::into).collect(),
            cameras: value.cameras.iter().map(Into::into).collect(),
            prompt: value.prompt.clone(),
            origin: Some(v1::Origin {
                source: value.origin.source.clone(),
                licence: value.origin.licence.clone(),
                attribution: value.origin.attribution.clone(),
            }),
            adversary: value.adversary.as_ref().map(Into::into),
        }
    }
}

impl TryFrom<v1::Scenario> for Scene {
    type Error = FieldError;
    fn try_from(message: v1::Scenario) -> Result<Self, FieldError> {
        if message.dt_ns <= 0 {
            return Err(FieldError::new("dt_ns", format!("is {}, not above 0", message.dt_ns)));
        }
        if message.ego_log.is_empty() {
            return Err(FieldError::new("ego_log", "is empty"));
        }
        if message.cameras.is_empty() {
            return Err(FieldError::new("cameras", "is empty"));
        }
        let origin = message.origin.unwrap_or_default();
        let tracks: Vec<Track> = list("tracks", message.tracks, MAX_AGENTS)?;
        let adversary = message.adversary.map(|part| adversary(part, &tracks)).transpose();
        let scene = Self {
            adversary: adversary.map_err(|error| error.below("adversary"))?,
            name: text("name", message.name, MAX_NAME_BYTES)?,
            family: text("family", message.family, MAX_NAME_BYTES)?,
            digest: digest("digest", &message.digest)?,
            dt: SimTime(message.dt_ns),
            map: part("map", message.map)?,
            vehicle: part("vehicle", message.vehicle)?,
            ego_log: list("ego_log", message.ego_log, MAX_TICKS)?,
            route: points("route", message.route, 0)?,
            tracks,
            cameras: list("cameras", message.cameras, MAX_CAMERAS)?,
            prompt: text("prompt", message.prompt, MAX_TEXT_BYTES)?,
            origin: Origin {
                source: text("origin.source", origin.source, MAX_TEXT_BYTES)?,
                licence: text("origin.licence", origin.licence, MAX_TEXT_BYTES)?,
                attribution: text("origin.attribution", origin.attribution, MAX_TEXT_BYTES)?,
            },
        };
        Ok(scene)
    }
}

impl From<&SceneMessage> for v1::Scene {
    fn from(value: &SceneMessage) -> Self {
        Self {
            header: None,
            spec: Some((&value.spec).into()),
            scenario: Some((&*value.scene).into()),
            first_frames: value.first_frames.iter().map(|frame| to_message(frame, Encoding::Png)).collect(),
            original_intrinsics: value.originals.iter().map(Into::into).collect(),
        }
    }
}

impl TryFrom<v1::Scene> for SceneMessage {
    type Error = FieldError;
    fn try_from(message: v1::Scene) -> Result<Self, FieldError> {
        let scene: Scene = part("scenario", message.scenario)?;
        let mut total = 0;
        for (index, frame) in message.first_frames.iter().enumerate() {
            let place = |error: FieldError| error.within("first_frames", index);
            total += pixels(frame.width_px, frame.height_px).map_err(place)?;
            if total > 2 * MAX_PIXELS {
                return Err(FieldError::new("first_frames", format!("hold more than {} pixels", 2 * MAX_PIXELS)));
            }
        }
        let frames: Vec<Lossless> = list("first_frames", message.first_frames, MAX_CAMERAS)?;
        let originals: Vec<Intrinsics> = list("original_intrinsics", message.original_intrinsics, MAX_CAMERAS)?;
        if !originals.is_empty() && originals.len() != scene.cameras.len() {
            let problem = format!("hold {} lenses of {} cameras", originals.len(), scene.cameras.len());
            return Err(FieldError::new("original_intrinsics", problem));
        }
        Ok(Self {
            spec: part("spec", message.spec)?,
            scene: Arc::new(scene),
            first_frames: frames.into_iter().map(|frame| frame.0).collect(),
            originals,
        })
    }
}

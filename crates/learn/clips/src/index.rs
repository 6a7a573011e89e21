//! The index of a set of clips: `index.json`, and what is told of each clip.

use ds_camera::{Appearance, Condition, Lighting, RoadSurface, Weather};
use ds_scenario::Facts;
use ds_space::{CameraId, CameraModel, DQuat, DVec3, Intrinsics, Pose};
use serde::{Deserialize, Serialize};

use crate::drive::Drive;
use crate::recipe::{Source, Split};

/// The name of the index in a set's folder.
pub const INDEX_FILE: &str = "index.json";

/// All clips of a set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Index {
    /// Schema version, 1.
    pub version: u32,
    /// The set's name.
    pub name: String,
    /// Digest of the recipe.
    pub recipe: String,
    /// What the set is for.
    pub split: Split,
    /// What the frames are.
    pub source: Source,
    /// Width of pictures, in pixels.
    pub width_px: u32,
    /// Height of pictures, in pixels.
    pub height_px: u32,
    /// Clips of a shard file.
    pub shard_clips: usize,
    /// The clips in order.
    pub clips: Vec<ClipInfo>,
}

/// What is told of one clip.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ClipInfo {
    /// Its index in the set.
    pub index: u64,
    /// The scenario's name.
    pub scenario: String,
    /// The scenario's family; empty if imported.
    pub family: String,
    /// The generator's seed; none if the scenario is a file.
    pub seed: Option<u64>,
    /// The scenario file, if it is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<std::path::PathBuf>,
    /// Digest of the scenario's content.
    pub scenario_digest: String,
    /// Identity of the road network.
    pub network: String,
    /// What the set is for.
    pub split: Split,
    /// The name of the look.
    pub appearance: String,
    /// The look on its axes and as numbers.
    pub condition: ConditionInfo,
    /// The prompt.
    pub prompt: String,
    /// What the prompt was written from.
    pub facts: Facts,
    /// The camera.
    pub camera: CameraInfo,
    /// How ego and world move.
    pub drive: DriveInfo,
    /// Layouts of the clip, one a tick.
    pub ticks: usize,
    /// Frames of the clip: as many as layouts, or 1 where only the first was edited.
    pub frames: usize,
    /// Whether class maps are kept.
    pub classes: bool,
    /// The clip of the edited set whose first frame was edited.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub edited: Option<u64>,
}

/// A look as numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "the fields of `ds_camera::Appearance`")]
pub struct ConditionInfo {
    pub lighting: String,
    pub weather: String,
    pub surface: String,
    pub sun_azimuth_rad: f64,
    pub sun_elevation_rad: f64,
    pub cloud: f64,
    pub haze: f64,
    pub wetness: f64,
    pub night: f64,
    pub fall: f64,
    pub cover: f64,
    pub palette_seed: u64,
}

impl ConditionInfo {
    pub(crate) fn of(appearance: &Appearance) -> Self {
        let condition = appearance.condition.unwrap_or(Condition::DAY);
        Self {
            lighting: condition.lighting().name().to_owned(),
            weather: condition.weather().name().to_owned(),
            surface: condition.surface().name().to_owned(),
            sun_azimuth_rad: appearance.sun_azimuth_rad,
            sun_elevation_rad: appearance.sun_elevation_rad,
            cloud: appearance.cloud,
            haze: appearance.haze,
            wetness: appearance.wetness,
            night: appearance.night,
            fall: appearance.fall,
            cover: appearance.cover,
            palette_seed: appearance.palette_seed,
        }
    }

    /// Returns the condition, or `None` if a name is none of its axis.
    #[must_use]
    pub fn condition(&self) -> Option<Condition> {
        let lighting = Lighting::ALL.iter().find(|value| value.name() == self.lighting)?;
        let weather = Weather::ALL.iter().find(|value| value.name() == self.weather)?;
        let surface = RoadSurface::ALL.iter().find(|value| value.name() == self.surface)?;
        Condition::new(*lighting, *weather, *surface).ok()
    }

    /// Returns the look as the camera takes it, or `None` if a name is none of its axis.
    #[must_use]
    pub fn appearance(&self) -> Option<Appearance> {
        Some(Appearance {
            sun_azimuth_rad: self.sun_azimuth_rad,
            sun_elevation_rad: self.sun_elevation_rad,
            cloud: self.cloud,
            haze: self.haze,
            wetness: self.wetness,
            night: self.night,
            palette_seed: self.palette_seed,
            fall: self.fall,
            cover: self.cover,
            condition: Some(self.condition()?),
        })
    }
}

/// A camera as numbers: pixels, metres, a unit quaternion (x, y, z, w).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraInfo {
    /// The camera's name.
    pub id: String,
    /// Width and height.
    pub size_px: [u32; 2],
    /// fx, fy, cx, cy.
    pub pinhole_px: [f64; 4],
    /// k1, k2.
    pub distortion: [f64; 2],
    /// Place on the rig.
    pub rig_from_camera_m: [f64; 3],
    /// Turn on the rig.
    pub rig_from_camera_xyzw: [f64; 4],
}

impl CameraInfo {
    pub(crate) fn of(camera: &CameraModel) -> Self {
        let lens = &camera.intrinsics;
        Self {
            id: camera.id.as_str().to_owned(),
            size_px: [lens.width_px, lens.height_px],
            pinhole_px: [lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px],
            distortion: [lens.k1, lens.k2],
            rig_from_camera_m: camera.rig_from_camera.translation.to_array(),
            rig_from_camera_xyzw: camera.rig_from_camera.rotation.to_array(),
        }
    }

    /// Returns the camera, or `None` if its name is no id.
    #[must_use]
    pub fn model(&self) -> Option<CameraModel> {
        let [fx_px, fy_px, cx_px, cy_px] = self.pinhole_px;
        let [width_px, height_px] = self.size_px;
        let [k1, k2] = self.distortion;
        let rotation = DQuat::from_array(self.rig_from_camera_xyzw);
        Some(CameraModel {
            id: CameraId::new(&self.id).ok()?,
            intrinsics: Intrinsics { width_px, height_px, fx_px, fy_px, cx_px, cy_px, k1, k2 },
            rig_from_camera: Pose::new(rotation, DVec3::from_array(self.rig_from_camera_m)),
        })
    }
}

/// A [`Drive`] as numbers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[expect(missing_docs, reason = "the fields of `Drive`")]
pub struct DriveInfo {
    pub from_tick: f64,
    pub world_rate: f64,
    pub ego_rate: f64,
    pub offset_m: f64,
    pub heading_rad: f64,
}

impl From<Drive> for DriveInfo {
    fn from(d: Drive) -> Self {
        let Drive { from_tick, world_rate, ego_rate, offset_m, heading_rad } = d;
        Self { from_tick, world_rate, ego_rate, offset_m, heading_rad }
    }
}

impl From<DriveInfo> for Drive {
    fn from(d: DriveInfo) -> Self {
        let DriveInfo { from_tick, world_rate, ego_rate, offset_m, heading_rad } = d;
        Self { from_tick, world_rate, ego_rate, offset_m, heading_rad }
    }
}

//! The structs of a scenario file, versions 1 and 2, as serde reads and writes them; see `scenarios/README.md`.
//!
//! Field names carry units; unknown fields are refused. Series run over ticks; a series of one value stands for a
//! constant. Nothing is checked here beyond shape: `resolve` does that, `compose` makes documents of scenes. Kinds are those of
//! the scene; the enums here say what they are called in files.

use ds_world::{AgentClass, LaneKind, LightState, LineColour, LineKind, StructureKind};
use serde::{Deserialize, Serialize};

/// What `format` must say.
pub(crate) const FORMAT: &str = "dreamstream-scenario";
/// What `version` must say; files with an adversary or structures are of [`RICHER_VERSION`].
pub(crate) const VERSION: u32 = 1;
/// What `version` says where there may be an adversary or structures.
pub(crate) const RICHER_VERSION: u32 = 2;
/// What `frame` must say.
pub(crate) const FRAME: &str = "x-east y-north z-up";

/// A point, x and y, in metres in the world.
pub(crate) type Point = [f64; 2];

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Document {
    pub format: String,
    pub version: u32,
    pub name: String,
    pub family: String,
    pub origin: OriginPart,
    pub prompt: String,
    pub frame: String,
    pub dt_secs: f64,
    pub vehicle: VehiclePart,
    pub cameras: Vec<CameraPart>,
    pub ego_log: EgoPart,
    pub route_m: Vec<Point>,
    pub tracks: Vec<TrackPart>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub adversary: Option<AdversaryPart>,
    pub map: MapPart,
}

/// The track that is meant to collide with the ego, by its index in `tracks`.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct AdversaryPart {
    pub track: u32,
    pub class: String,
    pub mode: String,
    pub attack_tick: u32,
    pub contact_tick: u32,
    pub budget: BudgetPart,
    pub corridor_m: Vec<Point>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct BudgetPart {
    pub attack_secs: f64,
    pub effort_mps: f64,
    pub aside_m: f64,
    pub reaims: u32,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct OriginPart {
    pub source: String,
    pub licence: String,
    pub attribution: String,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct VehiclePart {
    pub length_m: f64,
    pub width_m: f64,
    pub height_m: f64,
    pub wheel_base_m: f64,
    pub rear_axle_to_centre_m: f64,
    pub max_steering_rad: f64,
    pub max_steering_rate_radps: f64,
    pub max_acceleration_mps2: f64,
    pub max_deceleration_mps2: f64,
    pub mass_kg: f64,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct CameraPart {
    pub name: String,
    pub width_px: u32,
    pub height_px: u32,
    pub fx_px: f64,
    pub fy_px: f64,
    pub cx_px: f64,
    pub cy_px: f64,
    #[serde(default)]
    pub k1: f64,
    #[serde(default)]
    pub k2: f64,
    pub x_in_rig_m: f64,
    pub y_in_rig_m: f64,
    pub z_in_rig_m: f64,
    pub yaw_left_rad: f64,
    pub pitch_down_rad: f64,
    #[serde(default)]
    pub roll_rad: f64,
}

/// The rear axle in the world, velocities and accelerations in the rig.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct EgoPart {
    pub x_m: Vec<f64>,
    pub y_m: Vec<f64>,
    pub heading_rad: Vec<f64>,
    pub forward_mps: Vec<f64>,
    pub left_mps: Vec<f64>,
    pub yaw_rate_radps: Vec<f64>,
    pub forward_mps2: Vec<f64>,
    pub left_mps2: Vec<f64>,
    pub steering_rad: Vec<f64>,
    pub steering_rate_radps: Vec<f64>,
}

/// The class of a track.
#[derive(Serialize, Deserialize)]
#[serde(remote = "AgentClass", rename_all = "snake_case")]
enum ClassPart {
    Vehicle,
    Pedestrian,
    Cyclist,
    Cone,
    Barrier,
}

/// Centre of the box in the world; `valid_ticks` are the first and last of each stretch, series run over valid ticks.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct TrackPart {
    pub name: String,
    #[serde(with = "ClassPart")]
    pub class: AgentClass,
    pub length_m: f64,
    pub width_m: f64,
    pub height_m: f64,
    pub valid_ticks: Vec<[u32; 2]>,
    pub x_m: Vec<f64>,
    pub y_m: Vec<f64>,
    pub z_m: Vec<f64>,
    pub heading_rad: Vec<f64>,
    pub vx_mps: Vec<f64>,
    pub vy_mps: Vec<f64>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MapPart {
    pub lanes: Vec<LanePart>,
    pub junctions_m: Vec<Vec<Point>>,
    pub drivable_m: Vec<Vec<Point>>,
    pub road_edges_m: Vec<Vec<Point>>,
    pub lane_lines: Vec<LinePart>,
    pub crosswalks_m: Vec<Vec<Point>>,
    pub stop_lines: Vec<StopPart>,
    pub traffic_lights: Vec<LightPart>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub structures: Vec<StructurePart>,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "StructureKind", rename_all = "snake_case")]
enum StructureKindPart {
    Building,
    Vegetation,
    Pole,
    Fence,
    Wall,
}

/// A prism over an outline; heights are over the ground.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct StructurePart {
    #[serde(with = "StructureKindPart")]
    pub kind: StructureKind,
    #[serde(default)]
    pub bottom_m: f64,
    pub top_m: f64,
    pub outline_m: Vec<Point>,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "LaneKind", rename_all = "snake_case")]
enum LaneKindPart {
    Road,
    Connector,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct LanePart {
    pub name: String,
    #[serde(with = "LaneKindPart")]
    pub kind: LaneKind,
    pub speed_limit_mps: Option<f64>,
    pub successors: Vec<String>,
    pub predecessors: Vec<String>,
    pub left: Option<String>,
    pub right: Option<String>,
    pub centre_line_m: Vec<Point>,
    pub polygon_m: Vec<Point>,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "LineKind", rename_all = "snake_case")]
enum LineKindPart {
    Solid,
    Dashed,
    Double,
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "LineColour", rename_all = "snake_case")]
enum ColourPart {
    White,
    Yellow,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct LinePart {
    #[serde(with = "LineKindPart")]
    pub kind: LineKind,
    #[serde(with = "ColourPart")]
    pub colour: LineColour,
    pub points_m: Vec<Point>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct StopPart {
    /// Index of the light in `traffic_lights`.
    pub light: Option<u32>,
    pub points_m: [Point; 2],
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "LightState", rename_all = "snake_case")]
enum StatePart {
    Unknown,
    Red,
    Yellow,
    Green,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct LightPart {
    pub x_m: f64,
    pub y_m: f64,
    pub z_m: f64,
    pub facing_rad: f64,
    pub lanes: Vec<String>,
    /// Each state with the number of ticks that it lasts; the last one holds on.
    pub states: Vec<LastingPart>,
}

/// What a light shows and for how many ticks.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct LastingPart(#[serde(with = "StatePart")] pub LightState, pub u32);

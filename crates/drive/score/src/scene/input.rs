//! The plain data of an open-loop scene.

use ds_space::{DVec2, PoseSe2};
use ds_world::{AgentClass, Polygon};

use crate::footprint::Footprint;
use crate::motion::VehicleState;

/// What a map polygon is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AreaKind {
    /// A block of parallel lanes of one direction: drivable.
    Roadblock,
    /// A lane.
    Lane,
    /// A path through a junction.
    LaneConnector,
    /// A junction: drivable.
    Intersection,
    /// A car park: drivable.
    CarPark,
}

impl AreaKind {
    /// Says whether it is a lane or a connector.
    #[must_use]
    pub fn is_lane(self) -> bool {
        matches!(self, Self::Lane | Self::LaneConnector)
    }
}

/// A polygon of the map, in metres.
#[derive(Debug, Clone, PartialEq)]
pub struct MapArea {
    /// What it is.
    pub kind: AreaKind,
    /// Whether it is a lane or connector of the route.
    pub on_route: bool,
    /// Its outline, open.
    pub outline: Polygon,
    /// Its holes.
    pub holes: Vec<Polygon>,
}

/// Whether an object can be expected to move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ObjectClass {
    /// Vehicles, people, bicycles.
    Agent,
    /// Cones, barriers, signs, everything else.
    Static,
}

impl From<AgentClass> for ObjectClass {
    fn from(class: AgentClass) -> Self {
        if class.is_static() { Self::Static } else { Self::Agent }
    }
}

/// Pose of a box's centre and its velocity in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MovingBox {
    /// Centre and heading.
    pub pose: PoseSe2,
    /// Velocity, in metres per second.
    pub velocity_mps: DVec2,
}

/// An agent over the horizon.
#[derive(Debug, Clone, PartialEq)]
pub struct AgentTrack {
    /// Who it is; violations name it.
    pub id: u32,
    /// What it is.
    pub class: ObjectClass,
    /// Length along its heading, in metres.
    pub length_m: f64,
    /// Width across its heading, in metres.
    pub width_m: f64,
    /// One entry per 0.1 s from now on, `None` where absent; missing entries are absent.
    pub steps: Vec<Option<MovingBox>>,
}

/// A state of the past, rear axle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PastState {
    /// Time relative to now, in seconds, so not positive.
    pub time_s: f64,
    /// The state; steering and rates are not used.
    pub state: VehicleState,
}

/// What of a scene does not change from plan to plan.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct OpenLoopMap {
    /// The map near the ego.
    pub areas: Vec<MapArea>,
    /// The line along which progress is measured, in metres.
    pub centreline: Vec<DVec2>,
}

/// What of a scene belongs to one moment.
#[derive(Debug, Clone, PartialEq)]
pub struct SceneNow {
    /// The true state now.
    pub ego: VehicleState,
    /// States before now at rising times; `None` if unknown (HC is 1 then, as in the reference).
    pub past: Option<Vec<PastState>>,
    /// Everything that can be hit.
    pub agents: Vec<AgentTrack>,
    /// Per 0.1 s from now on, indices into the map's areas of the lane connectors that show red.
    pub red_areas: Vec<Vec<usize>>,
    /// The ego's rectangle.
    pub footprint: Footprint,
}

/// Everything a plan is scored against.
#[derive(Debug, Clone, PartialEq)]
pub struct OpenLoopScene {
    /// The map.
    pub map: OpenLoopMap,
    /// The moment.
    pub now: SceneNow,
}

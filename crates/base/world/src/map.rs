//! The road map: lanes, junctions, edges, markings, crosswalks, stop lines and traffic lights.

use std::borrow::Cow;

use ds_space::{DVec2, DVec3};

use crate::structure::Structure;

/// The index of a lane in [`Map::lanes`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct LaneId(pub u32);

/// A simple polygon in the world plane, in metres, without repeating its first point.
pub type Polygon = Vec<DVec2>;

/// What a lane is part of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum LaneKind {
    /// An ordinary lane of a road.
    Road,
    /// A path through a junction.
    Connector,
}

/// A lane: its centre line in driving direction and its surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Lane {
    /// The name in the scenario file.
    pub name: String,
    /// Road lane or junction connector.
    pub kind: LaneKind,
    /// Centre line in driving direction, in metres; at least two points.
    pub centre_line: Vec<DVec2>,
    /// Surface in metres; empty if the source has none (see [`Map::drivable`]).
    pub polygon: Polygon,
    /// Speed limit in metres per second, if known.
    pub speed_limit_mps: Option<f64>,
    /// Lanes that begin where this one ends.
    pub successors: Vec<LaneId>,
    /// Lanes that end where this one begins.
    pub predecessors: Vec<LaneId>,
    /// The lane to the left in the same direction, if any.
    pub left: Option<LaneId>,
    /// The lane to the right in the same direction, if any.
    pub right: Option<LaneId>,
}

/// The pattern of a lane line. The order stays: digests of scenes count by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum LineKind {
    /// An unbroken line.
    Solid,
    /// A dashed line.
    Dashed,
    /// Two parallel unbroken lines.
    Double,
}

/// The colour of a lane line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum LineColour {
    /// White paint.
    White,
    /// Yellow paint.
    Yellow,
}

/// A painted line along the road.
#[derive(Debug, Clone, PartialEq)]
pub struct LineMarking {
    /// Pattern.
    pub kind: LineKind,
    /// Colour.
    pub colour: LineColour,
    /// Points in metres; at least two.
    pub points: Vec<DVec2>,
}

/// The boundary between road and its surroundings.
#[derive(Debug, Clone, PartialEq)]
pub struct RoadEdge {
    /// Points in metres; at least two.
    pub points: Vec<DVec2>,
}

/// A pedestrian crossing.
#[derive(Debug, Clone, PartialEq)]
pub struct Crosswalk {
    /// Outline in metres.
    pub polygon: Polygon,
}

/// A line at which to stop, for lanes and possibly a light.
#[derive(Debug, Clone, PartialEq)]
pub struct StopLine {
    /// Both ends, in metres.
    pub points: [DVec2; 2],
    /// The index in [`Map::traffic_lights`] of the light that governs it, if any.
    pub light: Option<u32>,
}

/// What a traffic light shows. The order stays: digests of scenes count by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum LightState {
    /// Not known.
    Unknown,
    /// Stop.
    Red,
    /// About to stop.
    Yellow,
    /// Go.
    Green,
}

/// A traffic light head and the lanes that it governs.
#[derive(Debug, Clone, PartialEq)]
pub struct TrafficLight {
    /// Centre of the head, world frame, in metres.
    pub position: DVec3,
    /// The direction that the head faces, in radians.
    pub facing_rad: f64,
    /// Lanes that must obey it.
    pub lanes: Vec<LaneId>,
    /// What it shows at each tick; the last state holds on.
    pub states: Vec<LightState>,
}

impl TrafficLight {
    /// Returns what the light shows at a tick.
    #[must_use]
    pub fn at(&self, tick: ds_space::Tick) -> LightState {
        let last = self.states.len().saturating_sub(1);
        self.states.get((tick.0 as usize).min(last)).copied().unwrap_or(LightState::Unknown)
    }
}

/// The road map of a scene, world frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Map {
    /// Lanes, [`LaneId`] being the index.
    pub lanes: Vec<Lane>,
    /// Junction areas.
    pub junctions: Vec<Polygon>,
    /// Surfaces on which driving is allowed: lane polygons, junctions and widened connectors.
    pub drivable: Vec<Polygon>,
    /// Road edges.
    pub road_edges: Vec<RoadEdge>,
    /// Painted lines.
    pub line_markings: Vec<LineMarking>,
    /// Pedestrian crossings.
    pub crosswalks: Vec<Crosswalk>,
    /// Stop lines.
    pub stop_lines: Vec<StopLine>,
    /// Traffic lights.
    pub traffic_lights: Vec<TrafficLight>,
    /// What stands beside the road; empty where the source does not say.
    pub structures: Vec<Structure>,
}

impl Map {
    /// Returns the lane of an id.
    #[must_use]
    pub fn lane(&self, id: LaneId) -> Option<&Lane> {
        self.lanes.get(id.0 as usize)
    }

    /// Returns what stands beside the road; where the source does not say, what is placed there.
    #[must_use]
    pub fn structures_or(&self, place: impl FnOnce() -> Vec<Structure>) -> Cow<'_, [Structure]> {
        if self.structures.is_empty() { Cow::Owned(place()) } else { Cow::Borrowed(&self.structures) }
    }
}

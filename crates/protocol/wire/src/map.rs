//! The road map, part of `scene`. Indices of lanes and lights must lie inside their lists.

use ds_space::DVec2;
use ds_world::{
    Crosswalk, Lane, LaneId, LaneKind, LightState, LineColour, LineKind, LineMarking, Map, RoadEdge, StopLine,
    Structure, StructureKind, TrafficLight,
};

use crate::error::FieldError;
use crate::field::{choice, choices, enumeration, list, number, part, perhaps, text};
use crate::geometry::{points, polyline};
use crate::scene::{MAX_NAME_BYTES, MAX_TICKS};
use crate::v1;

/// The most lanes, junctions, crosswalks or stop lines.
pub(crate) const MAX_LANES: usize = 16_384;
/// The most areas, edges or markings.
pub(crate) const MAX_LINES: usize = 65_536;
/// The most traffic lights.
pub(crate) const MAX_LIGHTS: usize = 4_096;

enumeration!(v1::LaneKind, LaneKind, { Road = Road, Connector = Connector });
enumeration!(v1::LineKind, LineKind, { Solid = Solid, Dashed = Dashed, Double = Double });
enumeration!(v1::LineColour, LineColour, { White = White, Yellow = Yellow });
enumeration!(v1::StructureKind, StructureKind, {
    Building = Building, Vegetation = Vegetation, Pole = Pole, Fence = Fence, Wall = Wall
});

impl From<&Lane> for v1::Lane {
    fn from(value: &Lane) -> Self {
        let indices = |ids: &[LaneId]| ids.iter().map(|id| id.0).collect();
        Self {
            name: value.name.clone(),
            kind: v1::LaneKind::from(value.kind).into(),
            centre_line: Some(value.centre_line.as_slice().into()),
            polygon: Some(value.polygon.as_slice().into()),
            speed_limit_mps: value.speed_limit_mps,
            successors: indices(&value.successors),
            predecessors: indices(&value.predecessors),
            left: value.left.map(|id| id.0),
            right: value.right.map(|id| id.0),
        }
    }
}

impl TryFrom<v1::Lane> for Lane {
    type Error = FieldError;
    fn try_from(message: v1::Lane) -> Result<Self, FieldError> {
        let ids = |indices: Vec<u32>| indices.into_iter().map(LaneId).collect();
        Ok(Self {
            name: text("name", message.name, MAX_NAME_BYTES)?,
            kind: choice::<v1::LaneKind, _>("kind", message.kind)?,
            centre_line: points("centre_line", message.centre_line, 2)?,
            polygon: points("polygon", message.polygon, 0)?,
            speed_limit_mps: perhaps("speed_limit_mps", message.speed_limit_mps)?,
            successors: ids(message.successors),
            predecessors: ids(message.predecessors),
            left: message.left.map(LaneId),
            right: message.right.map(LaneId),
        })
    }
}

impl From<&LineMarking> for v1::LineMarking {
    fn from(value: &LineMarking) -> Self {
        Self {
            kind: v1::LineKind::from(value.kind).into(),
            colour: v1::LineColour::from(value.colour).into(),
            points: Some(value.points.as_slice().into()),
        }
    }
}

impl TryFrom<v1::LineMarking> for LineMarking {
    type Error = FieldError;
    fn try_from(message: v1::LineMarking) -> Result<Self, FieldError> {
        Ok(Self {
            kind: choice::<v1::LineKind, _>("kind", message.kind)?,
            colour: choice::<v1::LineColour, _>("colour", message.colour)?,
            points: points("points", message.points, 2)?,
        })
    }
}

impl From<&StopLine> for v1::StopLine {
    fn from(value: &StopLine) -> Self {
        Self { points: Some(value.points.as_slice().into()), light: value.light }
    }
}

impl TryFrom<v1::StopLine> for StopLine {
    type Error = FieldError;
    fn try_from(message: v1::StopLine) -> Result<Self, FieldError> {
        let ends = points("points", message.points, 2)?;
        let points = <[DVec2; 2]>::try_from(ends)
            .map_err(|ends| FieldError::new("points", format!("has {} points, exactly 2 are needed", ends.len())))?;
        Ok(Self { points, light: message.light })
    }
}

impl From<&TrafficLight> for v1::TrafficLight {
    fn from(value: &TrafficLight) -> Self {
        Self {
            position_m: Some(value.position.into()),
            facing_rad: Some(value.facing_rad),
            lanes: value.lanes.iter().map(|id| id.0).collect(),
            states: value.states.iter().map(|state| v1::LightState::from(*state).into()).collect(),
        }
    }
}

impl TryFrom<v1::TrafficLight> for TrafficLight {
    type Error = FieldError;
    fn try_from(message: v1::TrafficLight) -> Result<Self, FieldError> {
        Ok(Self {
            position: part("position_m", message.position_m)?,
            facing_rad: number("facing_rad", message.facing_rad)?,
            lanes: message.lanes.into_iter().map(LaneId).collect(),
            states: choices::<v1::LightState, LightState>("states", &message.states, MAX_TICKS)?,
        })
    }
}

impl From<&Structure> for v1::Structure {
    fn from(value: &Structure) -> Self {
        Self {
            kind: v1::StructureKind::from(value.kind).into(),
            outline: Some(value.outline.as_slice().into()),
            bottom_m: Some(value.bottom_m),
            top_m: Some(value.top_m),
        }
    }
}

impl TryFrom<v1::Structure> for Structure {
    type Error = FieldError;
    fn try_from(message: v1::Structure) -> Result<Self, FieldError> {
        Ok(Self {
            kind: choice::<v1::StructureKind, _>("kind", message.kind)?,
            outline: points("outline", message.outline, 3)?,
            bottom_m: number("bottom_m", message.bottom_m)?,
            top_m: number("top_m", message.top_m)?,
        })
    }
}

/// An outline or line, taken from a list of polylines.
struct Points(Vec<DVec2>);

impl TryFrom<v1::Polyline> for Points {
    type Error = FieldError;
    fn try_from(message: v1::Polyline) -> Result<Self, FieldError> {
        polyline(&message, 0).map(Self)
    }
}

fn lines<T>(field: &str, messages: Vec<v1::Polyline>, wrap: fn(Vec<DVec2>) -> T) -> Result<Vec<T>, FieldError> {
    let taken: Vec<Points> = list(field, messages, MAX_LINES)?;
    Ok(taken.into_iter().map(|points| wrap(points.0)).collect())
}

impl From<&Map> for v1::Map {
    fn from(value: &Map) -> Self {
        let outlines = |areas: &[Vec<DVec2>]| areas.iter().map(|area| area.as_slice().into()).collect();
        Self {
            lanes: value.lanes.iter().map(Into::into).collect(),
            junctions: outlines(&value.junctions),
            drivable: outlines(&value.drivable),
            road_edges: value.road_edges.iter().map(|edge| edge.points.as_slice().into()).collect(),
            line_markings: value.line_markings.iter().map(Into::into).collect(),
            crosswalks: value.crosswalks.iter().map(|crossing| crossing.polygon.as_slice().into()).collect(),
            stop_lines: value.stop_lines.iter().map(Into::into).collect(),
            traffic_lights: value.traffic_lights.iter().map(Into::into).collect(),
            structures: value.structures.iter().map(Into::into).collect(),
        }
    }
}

impl TryFrom<v1::Map> for Map {
    type Error = FieldError;
    fn try_from(message: v1::Map) -> Result<Self, FieldError> {
        let map = Self {
            lanes: list("lanes", message.lanes, MAX_LANES)?,
            junctions: lines("junctions", message.junctions, |points| points)?,
            drivable: lines("drivable", message.drivable, |points| points)?,
            road_edges: lines("road_edges", message.road_edges, |points| RoadEdge { points })?,
            line_markings: list("line_markings", message.line_markings, MAX_LINES)?,
            crosswalks: lines("crosswalks", message.crosswalks, |polygon| Crosswalk { polygon })?,
            stop_lines: list("stop_lines", message.stop_lines, MAX_LANES)?,
            traffic_lights: list("traffic_lights", message.traffic_lights, MAX_LIGHTS)?,
            structures: list("structures", message.structures, MAX_LINES)?,
        };
        check_indices(&map)?;
        Ok(map)
    }
}

fn check_indices(map: &Map) -> Result<(), FieldError> {
    let inside = |field: &str, id: LaneId| match map.lane(id) {
        Some(_) => Ok(()),
        None => Err(FieldError::new(field, format!("names lane {}, there are {}", id.0, map.lanes.len()))),
    };
    for (index, lane) in map.lanes.iter().enumerate() {
        let named = lane.successors.iter().map(|id| ("successors", id));
        let named = named.chain(lane.predecessors.iter().map(|id| ("predecessors", id)));
        let named = named.chain(lane.left.iter().map(|id| ("left", id)));
        for (field, id) in named.chain(lane.right.iter().map(|id| ("right", id))) {
            inside(field, *id).map_err(|error| error.within("lanes", index))?;
        }
    }
    for (index, light) in map.traffic_lights.iter().enumerate() {
        for id in &light.lanes {
            inside("lanes", *id).map_err(|error| error.within("traffic_lights", index))?;
        }
    }
    let lights = map.traffic_lights.len();
    for (index, line) in map.stop_lines.iter().enumerate() {
        if let Some(light) = line.light.filter(|light| *light as usize >= lights) {
            let error = FieldError::new("light", format!("names light {light}, there are {lights}"));
            return Err(error.within("stop_lines", index));
        }
    }
    Ok(())
}

//! Checks the map of a document: shapes, names, references between lanes, lights over time.

use std::collections::BTreeMap;

use ds_space::DVec3;
use ds_world::{Crosswalk, Lane, LaneId, LineMarking, Map, Polygon, RoadEdge, StopLine, Structure, TrafficLight};

use crate::document::{LanePart, LastingPart, LightPart, LinePart, MapPart, Point, StopPart, StructurePart};
use crate::place::{FAR_M, Fault, Place};

/// The highest that a structure may be, in metres.
const HIGH_M: f64 = 1_000.0;

type Names<'a> = BTreeMap<&'a str, LaneId>;

/// Checks a map and resolves its names.
pub(crate) fn map(at: &Place<'_>, part: &MapPart, ticks: usize) -> Result<Map, Fault> {
    let lanes_at = at.field("lanes");
    let mut names = Names::new();
    for (i, lane) in part.lanes.iter().enumerate() {
        let here = lanes_at.item(i);
        here.field("name").name(&lane.name)?;
        let id = LaneId(u32::try_from(i).map_err(|error| here.fault(error.to_string()))?);
        if let Some(first) = names.insert(&lane.name, id) {
            return Err(here.field("name").fault(format!("{:?} is the name of map.lanes[{}] too", lane.name, first.0)));
        }
    }
    Ok(Map {
        lanes: each(&lanes_at, &part.lanes, |here, part| lane(here, part, &names))?,
        junctions: polygons(&at.field("junctions_m"), &part.junctions_m)?,
        drivable: polygons(&at.field("drivable_m"), &part.drivable_m)?,
        road_edges: each(&at.field("road_edges_m"), &part.road_edges_m, |here, points| {
            Ok(RoadEdge { points: here.points(points, 2)? })
        })?,
        line_markings: each(&at.field("lane_lines"), &part.lane_lines, line)?,
        crosswalks: each(&at.field("crosswalks_m"), &part.crosswalks_m, |here, points| {
            Ok(Crosswalk { polygon: here.points(points, 3)? })
        })?,
        stop_lines: each(&at.field("stop_lines"), &part.stop_lines, |here, stop| {
            stop_line(here, stop, part.traffic_lights.len())
        })?,
        traffic_lights: each(&at.field("traffic_lights"), &part.traffic_lights, |here, part| {
            light(here, part, (&names, ticks))
        })?,
        structures: each(&at.field("structures"), &part.structures, structure)?,
    })
}

fn each<P, V>(at: &Place<'_>, parts: &[P], make: impl Fn(&Place<'_>, &P) -> Result<V, Fault>) -> Result<Vec<V>, Fault> {
    parts.iter().enumerate().map(|(i, part)| make(&at.item(i), part)).collect()
}

fn polygons(at: &Place<'_>, parts: &[Vec<Point>]) -> Result<Vec<Polygon>, Fault> {
    each(at, parts, |here, points| here.points(points, 3))
}

fn resolve(at: &Place<'_>, name: &str, names: &Names<'_>) -> Result<LaneId, Fault> {
    names.get(name).copied().ok_or_else(|| at.fault(format!("names lane {name:?}, which the map does not have")))
}

fn lane(at: &Place<'_>, part: &LanePart, names: &Names<'_>) -> Result<Lane, Fault> {
    let linked = |name, lanes: &[String]| each(&at.field(name), lanes, |here, lane| resolve(here, lane, names));
    let beside =
        |name, lane: &Option<String>| lane.as_ref().map(|lane| resolve(&at.field(name), lane, names)).transpose();
    let limit = part.speed_limit_mps.map(|limit| at.field("speed_limit_mps").size(limit, 100.0)).transpose()?;
    let outline = at.field("polygon_m");
    Ok(Lane {
        name: part.name.clone(),
        kind: part.kind,
        centre_line: at.field("centre_line_m").points(&part.centre_line_m, 2)?,
        polygon: outline.points(&part.polygon_m, if part.polygon_m.is_empty() { 0 } else { 3 })?,
        speed_limit_mps: limit,
        successors: linked("successors", &part.successors)?,
        predecessors: linked("predecessors", &part.predecessors)?,
        left: beside("left", &part.left)?,
        right: beside("right", &part.right)?,
    })
}

fn line(at: &Place<'_>, part: &LinePart) -> Result<LineMarking, Fault> {
    Ok(LineMarking { kind: part.kind, colour: part.colour, points: at.field("points_m").points(&part.points_m, 2)? })
}

fn stop_line(at: &Place<'_>, part: &StopPart, lights: usize) -> Result<StopLine, Fault> {
    if let Some(light) = part.light.filter(|light| *light as usize >= lights) {
        return Err(at.field("light").fault(format!("is {light}, the map has {lights} traffic lights")));
    }
    let ends = at.field("points_m");
    Ok(StopLine {
        points: [ends.item(0).point(part.points_m[0])?, ends.item(1).point(part.points_m[1])?],
        light: part.light,
    })
}

fn structure(at: &Place<'_>, part: &StructurePart) -> Result<Structure, Fault> {
    let bottom_m = at.field("bottom_m").within(part.bottom_m, 0.0, HIGH_M)?;
    let top_m = at.field("top_m").within(part.top_m, 0.0, HIGH_M)?;
    if top_m <= bottom_m {
        return Err(at.field("top_m").fault(format!("is {top_m}, not above bottom_m, which is {bottom_m}")));
    }
    Ok(Structure { kind: part.kind, outline: at.field("outline_m").points(&part.outline_m, 3)?, bottom_m, top_m })
}

fn light(at: &Place<'_>, part: &LightPart, scene: (&Names<'_>, usize)) -> Result<TrafficLight, Fault> {
    let (names, ticks) = scene;
    let position = DVec3::new(
        at.field("x_m").within(part.x_m, -FAR_M, FAR_M)?,
        at.field("y_m").within(part.y_m, -FAR_M, FAR_M)?,
        at.field("z_m").within(part.z_m, -10_000.0, 10_000.0)?,
    );
    let states_at = at.field("states");
    let mut states = Vec::new();
    for (i, LastingPart(state, count)) in part.states.iter().enumerate() {
        if *count == 0 || states.len() + *count as usize > ticks {
            let problem = format!("lasts {count} ticks; states last 1 tick or more and {ticks} in all at most");
            return Err(states_at.item(i).fault(problem));
        }
        states.extend(std::iter::repeat_n(*state, *count as usize));
    }
    Ok(TrafficLight {
        position,
        facing_rad: at.field("facing_rad").within(part.facing_rad, -7.0, 7.0)?,
        lanes: each(&at.field("lanes"), &part.lanes, |here, lane| resolve(here, lane, names))?,
        states,
    })
}

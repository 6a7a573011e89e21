//! The map of a log: lane segments, drivable areas, pedestrian crossings.
//!
//! A lane's centre line is the file's or lies midway between its boundaries. Lines that two lanes share are painted
//! once; edges of drivable areas between two such areas are no road edges. Heights are left out. Segments inside
//! intersections are connectors, their surfaces junctions. Bicycle lanes are lanes, but nobody's neighbours.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path as FilePath;

use ds_scenario::Warning;
use ds_space::DVec2;
use ds_space::plane::path::{Path, thin};
use ds_world::{Crosswalk, Lane, LaneKind, LineColour, LineKind, LineMarking, Map};
use serde::Deserialize;

use super::left_out;
use crate::boundary::{between, kerbs, midway, outline, place};
use crate::error::ImportError;
use crate::file::bytes;
use crate::scenarionet::lanes::{Links, link_by_name};
use crate::view::FieldFault;

/// The farthest that a point may lie from the drive, in metres.
const FAR_M: f64 = 1e5;
/// The most lanes, areas or crossings of a map.
const MOST_PARTS: usize = 20_000;

#[derive(Deserialize)]
struct Archive {
    lane_segments: BTreeMap<String, Segment>,
    #[serde(default)]
    drivable_areas: BTreeMap<String, Area>,
    #[serde(default)]
    pedestrian_crossings: BTreeMap<String, Crossing>,
}

#[derive(Deserialize)]
struct Point {
    x: f64,
    y: f64,
}

#[derive(Deserialize)]
struct Segment {
    id: i64,
    is_intersection: bool,
    lane_type: String,
    left_lane_boundary: Vec<Point>,
    right_lane_boundary: Vec<Point>,
    left_lane_mark_type: String,
    right_lane_mark_type: String,
    #[serde(default)]
    centerline: Option<Vec<Point>>,
    successors: Vec<i64>,
    predecessors: Vec<i64>,
    left_neighbor_id: Option<i64>,
    right_neighbor_id: Option<i64>,
}

#[derive(Deserialize)]
struct Area {
    area_boundary: Vec<Point>,
}

#[derive(Deserialize)]
struct Crossing {
    edge1: Vec<Point>,
    edge2: Vec<Point>,
}

/// Reads a map, positions moved by `-origin`.
pub(super) fn read(path: &FilePath, origin: DVec2, notes: &mut Vec<Warning>) -> Result<Map, ImportError> {
    let bytes = bytes(path)?;
    let mut reader = serde_json::Deserializer::from_slice(&bytes);
    let archive: Result<Archive, _> = serde_path_to_error::deserialize(&mut reader);
    let archive = archive
        .map_err(|error| FieldFault { at: error.path().to_string(), problem: error.into_inner().to_string() })
        .and_then(|archive| convert(&archive, origin, notes));
    archive.map_err(|fault| ImportError::field(path, fault))
}

fn convert(archive: &Archive, origin: DVec2, notes: &mut Vec<Warning>) -> Result<Map, FieldFault> {
    let counts = [
        ("lane_segments", archive.lane_segments.len()),
        ("drivable_areas", archive.drivable_areas.len()),
        ("pedestrian_crossings", archive.pedestrian_crossings.len()),
    ];
    if let Some((at, count)) = counts.into_iter().find(|(_, count)| *count > MOST_PARTS) {
        return Err(FieldFault {
            at: at.to_owned(),
            problem: format!("has {count} parts, over the limit of {MOST_PARTS}"),
        });
    }
    let mut map = Map::default();
    for (key, area) in &archive.drivable_areas {
        map.drivable.push(outline(line(
            &area.area_boundary,
            origin,
            3,
            &format!("drivable_areas.{key}.area_boundary"),
        )?));
    }
    for (key, crossing) in &archive.pedestrian_crossings {
        let edge =
            |points: &[Point], name: &str| line(points, origin, 2, &format!("pedestrian_crossings.{key}.{name}"));
        map.crosswalks
            .push(Crosswalk { polygon: between(edge(&crossing.edge1, "edge1")?, edge(&crossing.edge2, "edge2")?) });
    }
    lanes(archive, origin, &mut map, notes)?;
    if map.drivable.is_empty() {
        map.drivable = map.lanes.iter().map(|lane| lane.polygon.clone()).collect();
    }
    map.road_edges = kerbs(&map.drivable)?;
    Ok(map)
}

/// Returns the points of a line near the drive.
fn line(points: &[Point], origin: DVec2, least: usize, at: &str) -> Result<Vec<DVec2>, FieldFault> {
    let moved: Vec<DVec2> = points.iter().map(|point| DVec2::new(point.x, point.y) - origin).collect();
    if let Some(i) = moved.iter().position(|point| point.abs().max_element() > FAR_M) {
        let problem = format!("lies more than {FAR_M} m from the drive: {}, {}", points[i].x, points[i].y);
        return Err(FieldFault { at: format!("{at}[{i}]"), problem });
    }
    if moved.len() < least {
        let problem = format!("has {} points, at least {least} are needed", moved.len());
        return Err(FieldFault { at: at.to_owned(), problem });
    }
    Ok(moved)
}

fn lanes(archive: &Archive, origin: DVec2, map: &mut Map, notes: &mut Vec<Warning>) -> Result<(), FieldFault> {
    let (mut links, mut painted, mut unknown) = (Vec::new(), BTreeSet::new(), BTreeMap::new());
    let by_id: BTreeMap<i64, &Segment> = archive.lane_segments.values().map(|segment| (segment.id, segment)).collect();
    for (key, segment) in &archive.lane_segments {
        let at = |name: &str| format!("lane_segments.{key}.{name}");
        let left = line(&segment.left_lane_boundary, origin, 2, &at("left_lane_boundary"))?;
        let right = line(&segment.right_lane_boundary, origin, 2, &at("right_lane_boundary"))?;
        let centre =
            segment.centerline.as_ref().map(|points| line(points, origin, 2, &at("centerline"))).transpose()?;
        let centre = centre.or_else(|| midway(&left, &right)).and_then(|points| Path::new(&points));
        let no_length = || FieldFault { at: at("left_lane_boundary"), problem: "has no length".to_owned() };
        let centre_line = thin(centre.ok_or_else(no_length)?.points(), 0.01, 6.0);
        for (points, mark) in [(&left, &segment.left_lane_mark_type), (&right, &segment.right_lane_mark_type)] {
            match marking(mark) {
                Mark::Painted(kind, colour) if painted.insert(place(points)) => {
                    map.line_markings.push(LineMarking { kind, colour, points: points.clone() });
                }
                Mark::Painted(..) | Mark::None => {}
                Mark::Unknown => *unknown.entry(mark.clone()).or_default() += 1,
            }
        }
        let polygon = between(left, right);
        if segment.is_intersection {
            map.junctions.push(polygon.clone());
        }
        map.lanes.push(Lane {
            name: segment.id.to_string(),
            kind: if segment.is_intersection { LaneKind::Connector } else { LaneKind::Road },
            centre_line,
            polygon,
            speed_limit_mps: None,
            successors: Vec::new(),
            predecessors: Vec::new(),
            left: None,
            right: None,
        });
        let names = |ids: &[i64]| ids.iter().map(i64::to_string).collect();
        let beside = |id: Option<i64>| {
            let is_lane = |other: &&&Segment| other.lane_type != "BIKE" && along(segment).dot(along(other)) > 0.0;
            id.and_then(|id| by_id.get(&id)).filter(is_lane).map(|other| other.id.to_string()).into_iter().collect()
        };
        links.push(Links {
            exits: names(&segment.successors),
            entries: names(&segment.predecessors),
            left: beside(segment.left_neighbor_id),
            right: beside(segment.right_neighbor_id),
        });
    }
    link_by_name(map, &links);
    left_out("lane_segments.lane_mark_type", unknown, notes);
    Ok(())
}

/// Returns the way from the first to the last point of a lane.
fn along(segment: &Segment) -> DVec2 {
    let ends =
        |points: &[Point]| Some((points.first()?, points.last()?)).map(|(a, b)| DVec2::new(b.x - a.x, b.y - a.y));
    ends(&segment.left_lane_boundary).unwrap_or_default()
}

enum Mark {
    None,
    Unknown,
    Painted(LineKind, LineColour),
}

/// Returns what a mark type paints; of a solid line beside a dashed one both are solid.
fn marking(name: &str) -> Mark {
    let Some((kind, colour)) = name.rsplit_once('_') else {
        return if matches!(name, "NONE" | "UNKNOWN") { Mark::None } else { Mark::Unknown };
    };
    let kind = match kind {
        "SOLID" => LineKind::Solid,
        "DASHED" | "DOUBLE_DASH" => LineKind::Dashed,
        "DOUBLE_SOLID" | "SOLID_DASH" | "DASH_SOLID" => LineKind::Double,
        _ => return Mark::Unknown,
    };
    match colour {
        "WHITE" => Mark::Painted(kind, LineColour::White),
        "YELLOW" => Mark::Painted(kind, LineColour::Yellow),
        // Blue marks parking for the disabled.
        "BLUE" => Mark::Painted(kind, LineColour::White),
        _ => Mark::Unknown,
    }
}

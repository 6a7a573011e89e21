//! The map: lanes with their links, lane lines, edges, crosswalks, stop signs, drivable surfaces.
//!
//! Links are the file's where it has them, else lanes that end where others begin. Lanes without a polygon (junction
//! connectors, Waymo lanes) are widened along their centre line to make the drivable surface. What has no place in
//! the scene (speed bumps, unknown types, lines of one point) is left out and counted in a warning.

use std::collections::BTreeMap;

use ds_scenario::Warning;
use ds_space::plane::path::{Path, thin};
use ds_space::{DVec2, angle};
use ds_world::{Crosswalk, Lane, LaneId, LaneKind, LineColour, LineKind, LineMarking, Map, RoadEdge, StopLine};

use super::Window;
use crate::view::{FieldFault, View};

/// Half the width given to a lane without a polygon, in metres.
pub(crate) const HALF_WIDTH_M: f64 = 1.95;
/// How far apart the ends of linked lanes may lie, in metres.
const LINK_M: f64 = 1.2;
const LINK_RAD: f64 = 0.6;
/// Longest line of a map, in metres; lines are sampled at steps of half a metre.
const LONGEST_M: f64 = 1e5;

/// The links of a lane as the file names them.
#[derive(Debug, Default)]
pub(crate) struct Links {
    pub exits: Vec<String>,
    pub entries: Vec<String>,
    pub left: Vec<String>,
    pub right: Vec<String>,
}

pub(super) fn map(
    features: &View<'_>,
    window: &Window,
    dataset: &str,
    notes: &mut Vec<Warning>,
) -> Result<Map, FieldFault> {
    let mut map = Map::default();
    let mut links = Vec::new();
    let mut skipped: BTreeMap<String, usize> = BTreeMap::new();
    for (name, view) in features.entries()? {
        let kind = view.need("type")?;
        let kind = kind.text().ok_or_else(|| kind.fault("is no text"))?;
        let taken = if kind.starts_with("LANE_") {
            let lane = lane(name, &view, window, dataset)?;
            let taken = lane.is_some();
            if let Some((lane, surface, linked)) = lane {
                map.lanes.push(lane);
                map.drivable.push(surface);
                links.push(linked);
            }
            taken
        } else {
            feature(&mut map, &kind, &view, window)?
        };
        if !taken {
            *skipped.entry(kind).or_default() += 1;
        }
    }
    for (kind, count) in skipped {
        notes.push(Warning {
            at: "map_features".to_owned(),
            message: format!("{count} of type {kind:?} have no place in the scene or too few points"),
        });
    }
    mark_connectors(&mut map);
    if links.iter().any(|links| !links.exits.is_empty() || !links.entries.is_empty()) {
        link_by_name(&mut map, &links);
    } else {
        link_by_place(&mut map);
        neighbours_by_place(&mut map);
    }
    Ok(map)
}

fn shifted(view: Option<View<'_>>, window: &Window) -> Result<Vec<DVec2>, FieldFault> {
    let Some(view) = view else { return Ok(Vec::new()) };
    let mut points: Vec<DVec2> = view.points()?.into_iter().map(|point| point - window.origin).collect();
    points.dedup_by(|a, b| a.distance(*b) < 1e-3);
    let length_m: f64 = points.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
    if length_m > LONGEST_M {
        return Err(view.fault(format!("is {length_m} m long, at most {LONGEST_M} are read")));
    }
    Ok(points)
}

/// Returns an outline without the repetition of its first point.
fn outline(view: Option<View<'_>>, window: &Window) -> Result<Vec<DVec2>, FieldFault> {
    let mut points = shifted(view, window)?;
    if points.len() > 1 && points[0].distance(points[points.len() - 1]) < 1e-3 {
        points.pop();
    }
    Ok(points)
}

type Parts = (Lane, Vec<DVec2>, Links);

fn lane(name: String, view: &View<'_>, window: &Window, dataset: &str) -> Result<Option<Parts>, FieldFault> {
    let points = shifted(view.get("polyline"), window)?;
    let Some(path) = Path::new(&points) else { return Ok(None) };
    let polygon = outline(view.get("polygon"), window)?;
    let polygon = if polygon.len() < 3 { Vec::new() } else { polygon };
    let half_m = view
        .get("width")
        .and_then(|width| width.table().ok())
        .map(|table| table.values.iter().sum::<f64>() / table.rows.max(1) as f64 * 0.5)
        .filter(|half| (1.2..6.0).contains(half))
        .unwrap_or(HALF_WIDTH_M);
    let surface = if polygon.is_empty() { widened(&path, half_m) } else { polygon.clone() };
    let interpolating = view.get("interpolating").and_then(|value| value.number()).unwrap_or(0.0) != 0.0;
    // The converter writes a constant for nuScenes, which records no limits.
    let limit = if dataset == "nuscenes" { None } else { speed_limit(view) };
    let lane = Lane {
        name,
        kind: if interpolating { LaneKind::Connector } else { LaneKind::Road },
        centre_line: thin(path.points(), 0.005, 6.0),
        polygon,
        speed_limit_mps: limit,
        successors: Vec::new(),
        predecessors: Vec::new(),
        left: None,
        right: None,
    };
    let links = Links {
        exits: names(view.get("exit_lanes")),
        entries: names(view.get("entry_lanes")),
        left: names(view.get("left_neighbor")),
        right: names(view.get("right_neighbor")),
    };
    Ok(Some((lane, surface, links)))
}

/// Returns the surface of a lane of even width.
pub(crate) fn widened(path: &Path, half_m: f64) -> Vec<DVec2> {
    let even = path.even(1.0);
    let mut surface = thin(&even.offset(half_m), 0.02, 20.0);
    surface.extend(thin(&even.offset(-half_m), 0.02, 20.0).into_iter().rev());
    surface
}

fn speed_limit(view: &View<'_>) -> Option<f64> {
    let kmh = view.get("speed_limit_kmh").and_then(|limit| limit.number()).map(|limit| limit / 3.6);
    let mph = || view.get("speed_limit_mph").and_then(|limit| limit.number()).map(|limit| limit * 0.447_04);
    kmh.or_else(mph).filter(|limit| *limit > 0.5 && *limit < 70.0)
}

/// Reads lane names given as texts or as dicts with a `feature_id`.
fn names(view: Option<View<'_>>) -> Vec<String> {
    let Some(view) = view else { return Vec::new() };
    let items = view.items();
    if items.is_empty() {
        return view.texts();
    }
    items.iter().filter_map(|item| item.get("feature_id").map_or_else(|| item.text(), |id| id.text())).collect()
}

/// Adds a feature that is no lane; says whether it has a place in the scene.
fn feature(map: &mut Map, kind: &str, view: &View<'_>, window: &Window) -> Result<bool, FieldFault> {
    if kind.starts_with("ROAD_LINE_") || kind == "UNKNOWN_LINE" {
        let points = thin(&shifted(view.get("polyline"), window)?, 0.005, 30.0);
        let colour = if kind.contains("YELLOW") { LineColour::Yellow } else { LineColour::White };
        let kind = match (kind.contains("DOUBLE"), kind.contains("BROKEN")) {
            (true, _) => LineKind::Double,
            (_, true) => LineKind::Dashed,
            _ => LineKind::Solid,
        };
        let taken = points.len() > 1;
        map.line_markings.extend(taken.then_some(LineMarking { kind, colour, points }));
        return Ok(taken);
    }
    if kind.starts_with("ROAD_EDGE_") || kind.starts_with("BOUNDARY_") {
        let line = view.get("polyline").or_else(|| view.get("polygon"));
        let points = thin(&shifted(line, window)?, 0.005, 30.0);
        let taken = points.len() > 1;
        map.road_edges.extend(taken.then_some(RoadEdge { points }));
        return Ok(taken);
    }
    let area = outline(view.get("polygon").or_else(|| view.get("polyline")), window)?;
    match kind {
        "CROSSWALK" if area.len() > 2 => map.crosswalks.push(Crosswalk { polygon: area }),
        "INTERSECTION" | "JUNCTION" if area.len() > 2 => {
            map.junctions.push(area.clone());
            map.drivable.push(area);
        }
        "DRIVEWAY" | "GENERIC_DRIVABLE" | "CARPARK_AREA" if area.len() > 2 => map.drivable.push(area),
        "STOP_LINE" if area.len() > 1 => {
            map.stop_lines.push(StopLine { points: [area[0], area[area.len() - 1]], light: None })
        }
        "STOP_SIGN" => return Ok(stop_sign(map, view, window)),
        _ => return Ok(false),
    }
    Ok(true)
}

/// A stop sign becomes a stop line across its lanes where it stands; lanes must come before it in the file.
fn stop_sign(map: &mut Map, view: &View<'_>, window: &Window) -> bool {
    let Some(place) =
        view.get("position").and_then(|position| position.table().ok()).filter(|table| table.values.len() > 1)
    else {
        return false;
    };
    let place = DVec2::new(place.values[0], place.values[1]) - window.origin;
    let lanes = names(view.get("lane"));
    let found: Vec<StopLine> =
        map.lanes.iter().filter(|lane| lanes.contains(&lane.name)).filter_map(|lane| across(lane, place)).collect();
    let taken = !found.is_empty();
    map.stop_lines.extend(found);
    taken
}

/// Returns the line across a lane next to a place.
pub(crate) fn across(lane: &Lane, place: DVec2) -> Option<StopLine> {
    let path = Path::new(&lane.centre_line)?;
    let station = path.nearest(place).station_m.clamp(0.0, path.length_m());
    let pose = path.pose(station);
    let side = pose.left() * 1.7;
    Some(StopLine { points: [pose.position + side, pose.position - side], light: None })
}

/// Where some lanes have polygons, those without are connectors.
fn mark_connectors(map: &mut Map) {
    if map.lanes.iter().any(|lane| !lane.polygon.is_empty()) {
        for lane in map.lanes.iter_mut().filter(|lane| lane.polygon.is_empty()) {
            lane.kind = LaneKind::Connector;
        }
    }
}

fn id(index: usize) -> LaneId {
    LaneId(u32::try_from(index).unwrap_or(u32::MAX))
}

fn link(map: &mut Map, from: usize, to: usize) {
    if from != to && !map.lanes[from].successors.contains(&id(to)) {
        map.lanes[from].successors.push(id(to));
        map.lanes[to].predecessors.push(id(from));
    }
}

pub(crate) fn link_by_name(map: &mut Map, links: &[Links]) {
    let index: BTreeMap<String, usize> = map.lanes.iter().enumerate().map(|(i, lane)| (lane.name.clone(), i)).collect();
    for (i, links) in links.iter().enumerate() {
        for exit in links.exits.iter().filter_map(|name| index.get(name)) {
            link(map, i, *exit);
        }
        for entry in links.entries.iter().filter_map(|name| index.get(name)) {
            link(map, *entry, i);
        }
        let first = |names: &[String]| {
            names.iter().find_map(|name| index.get(name)).filter(|other| **other != i).map(|other| id(*other))
        };
        map.lanes[i].left = first(&links.left);
        map.lanes[i].right = first(&links.right);
    }
}

fn ends(lane: &Lane) -> (DVec2, f64, DVec2, f64) {
    let line = &lane.centre_line;
    let last = line.len() - 1;
    let (first, after) = (line[1] - line[0], line[last] - line[last - 1]);
    (line[0], first.y.atan2(first.x), line[last], after.y.atan2(after.x))
}

fn link_by_place(map: &mut Map) {
    let ends: Vec<_> = map.lanes.iter().map(ends).collect();
    let mut starts: Vec<usize> = (0..ends.len()).collect();
    starts.sort_by(|a, b| ends[*a].0.x.total_cmp(&ends[*b].0.x));
    for (from, (_, _, end, heading)) in ends.iter().enumerate() {
        let low = starts.partition_point(|i| ends[*i].0.x < end.x - LINK_M);
        for to in starts[low..].iter().take_while(|i| ends[**i].0.x <= end.x + LINK_M) {
            let (start, begins, ..) = ends[*to];
            if start.distance(*end) < LINK_M && angle::turn(*heading, begins).abs() < LINK_RAD {
                link(map, from, *to);
            }
        }
    }
}

/// Finds the lanes beside road lanes: alongside at the middle, 2 to 5 m to a side, in the same direction.
fn neighbours_by_place(map: &mut Map) {
    const MOST_LANES: usize = 4000;
    let roads: Vec<(usize, Path)> = (0..map.lanes.len())
        .filter(|i| map.lanes[*i].kind == LaneKind::Road)
        .filter_map(|i| Path::new(&map.lanes[i].centre_line).map(|path| (i, path)))
        .collect();
    if roads.len() > MOST_LANES {
        return;
    }
    for (i, path) in &roads {
        let middle = path.pose(0.5 * path.length_m());
        let mut beside = [(f64::INFINITY, None), (f64::INFINITY, None)];
        for (j, other) in roads.iter().filter(|(j, _)| j != i) {
            let reach = other.length_m() + 5.0;
            if other.points()[0].distance_squared(middle.position) > reach * reach {
                continue;
            }
            let foot = other.nearest(middle.position);
            let inside = (0.0..=other.length_m()).contains(&foot.station_m);
            let turn = angle::turn(middle.heading_rad, other.heading_rad(foot.station_m));
            let side = usize::from(foot.left_m > 0.0);
            if inside
                && turn.abs() < 0.3
                && (2.0..5.0).contains(&foot.left_m.abs())
                && foot.left_m.abs() < beside[side].0
            {
                beside[side] = (foot.left_m.abs(), Some(id(*j)));
            }
        }
        // A lane that has this one to its left lies to the right of this one.
        map.lanes[*i].left = beside[0].1;
        map.lanes[*i].right = beside[1].1;
    }
}

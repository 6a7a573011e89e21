//! The map expansion of nuScenes: nodes, lines, polygons and what refers to them, around a drive.
//!
//! Lanes follow their arc-line paths (three arcs of one radius: left, straight, right). Road blocks and drivable areas
//! are the surface; lane and road dividers the lines. Metres, axes of the city map.

use std::collections::BTreeMap;
use std::path::Path;

use ds_space::DVec2;
use ds_space::plane::polygon::long_axis;
use ds_world::{
    Crosswalk, Lane, LaneId, LaneKind, LightState, LineColour, LineKind, LineMarking, Map, RoadEdge, StopLine,
    TrafficLight,
};
use serde::Deserialize;

use crate::error::ImportError;
use crate::recorded::Stand;

/// How far from the drive the map is kept, in metres.
const REACH_M: f64 = 150.0;

#[derive(Deserialize)]
struct Tables {
    node: Vec<Node>,
    #[serde(default)]
    line: Vec<Line>,
    polygon: Vec<Outline>,
    #[serde(default)]
    drivable_area: Vec<Area>,
    #[serde(default)]
    road_segment: Vec<Surface>,
    #[serde(default)]
    lane: Vec<Surface>,
    #[serde(default)]
    lane_connector: Vec<Surface>,
    #[serde(default)]
    ped_crossing: Vec<Surface>,
    #[serde(default)]
    stop_line: Vec<Surface>,
    #[serde(default)]
    road_divider: Vec<Divider>,
    #[serde(default)]
    lane_divider: Vec<Divider>,
    #[serde(default)]
    traffic_light: Vec<Light>,
    #[serde(default)]
    arcline_path_3: BTreeMap<String, Vec<Arcs>>,
    #[serde(default)]
    connectivity: BTreeMap<String, Links>,
}

#[derive(Deserialize)]
struct Node {
    token: String,
    x: f64,
    y: f64,
}

#[derive(Deserialize)]
struct Line {
    token: String,
    node_tokens: Vec<String>,
}

#[derive(Deserialize)]
struct Outline {
    token: String,
    exterior_node_tokens: Vec<String>,
}

#[derive(Deserialize)]
struct Area {
    polygon_tokens: Vec<String>,
}

#[derive(Deserialize)]
struct Surface {
    token: String,
    polygon_token: String,
    #[serde(default)]
    is_intersection: bool,
    #[serde(default)]
    stop_line_type: String,
}

#[derive(Deserialize)]
struct Divider {
    line_token: String,
    #[serde(default)]
    lane_divider_segments: Vec<Segment>,
}

#[derive(Deserialize)]
struct Segment {
    #[serde(default)]
    segment_type: String,
}

#[derive(Deserialize)]
struct Light {
    line_token: String,
    #[serde(default)]
    pose: LightPose,
}

#[derive(Deserialize, Default)]
struct LightPose {
    #[serde(default)]
    tz: f64,
}

#[derive(Deserialize)]
struct Arcs {
    start_pose: [f64; 3],
    shape: String,
    radius: f64,
    segment_length: [f64; 3],
}

#[derive(Deserialize, Default)]
struct Links {
    #[serde(default)]
    outgoing: Vec<String>,
}

/// Reads the map of a city around a drive.
pub(super) fn read(path: &Path, stands: &[Stand]) -> Result<Map, ImportError> {
    let unreadable = |source| ImportError::Read { path: path.to_owned(), source };
    let file = std::fs::File::open(path).map_err(unreadable)?;
    let mut reader = serde_json::Deserializer::from_reader(std::io::BufReader::new(file));
    let tables: Tables = serde_path_to_error::deserialize(&mut reader).map_err(|error| ImportError::Field {
        path: path.to_owned(),
        at: error.path().to_string(),
        problem: error.into_inner().to_string(),
    })?;
    Ok(City::new(&tables, stands).map())
}

/// The tables with their look-ups.
struct City<'a> {
    tables: &'a Tables,
    nodes: BTreeMap<&'a str, DVec2>,
    lines: BTreeMap<&'a str, &'a Line>,
    outlines: BTreeMap<&'a str, &'a Outline>,
    low: DVec2,
    high: DVec2,
}

impl<'a> City<'a> {
    fn new(tables: &'a Tables, stands: &[Stand]) -> Self {
        let places = || stands.iter().map(|stand| stand.position.truncate());
        Self {
            tables,
            nodes: tables.node.iter().map(|node| (node.token.as_str(), DVec2::new(node.x, node.y))).collect(),
            lines: tables.line.iter().map(|line| (line.token.as_str(), line)).collect(),
            outlines: tables.polygon.iter().map(|outline| (outline.token.as_str(), outline)).collect(),
            low: places().reduce(DVec2::min).unwrap_or_default() - REACH_M,
            high: places().reduce(DVec2::max).unwrap_or_default() + REACH_M,
        }
    }

    fn near(&self, points: &[DVec2]) -> bool {
        let (Some(low), Some(high)) =
            (points.iter().copied().reduce(DVec2::min), points.iter().copied().reduce(DVec2::max))
        else {
            return false;
        };
        low.cmple(self.high).all() && high.cmpge(self.low).all()
    }

    fn points(&self, tokens: &[String]) -> Vec<DVec2> {
        tokens.iter().filter_map(|token| self.nodes.get(token.as_str()).copied()).collect()
    }

    /// Returns a polygon near the drive.
    fn polygon(&self, token: &str) -> Option<Vec<DVec2>> {
        let points = self.points(&self.outlines.get(token)?.exterior_node_tokens);
        (points.len() >= 3 && self.near(&points)).then_some(points)
    }

    fn line(&self, token: &str) -> Option<Vec<DVec2>> {
        let points = self.points(&self.lines.get(token)?.node_tokens);
        (points.len() >= 2 && self.near(&points)).then_some(points)
    }

    fn map(&self) -> Map {
        let tables = self.tables;
        let polygons = |surfaces: &'a [Surface], wanted: &dyn Fn(&Surface) -> bool| -> Vec<Vec<DVec2>> {
            surfaces.iter().filter(|surface| wanted(surface)).filter_map(|s| self.polygon(&s.polygon_token)).collect()
        };
        let areas = tables.drivable_area.iter().flat_map(|area| &area.polygon_tokens);
        let drivable: Vec<Vec<DVec2>> = areas.filter_map(|token| self.polygon(token)).collect();
        let mut map = Map {
            lanes: self.lanes(),
            junctions: polygons(&tables.road_segment, &|segment| segment.is_intersection),
            road_edges: drivable.iter().map(|area| RoadEdge { points: closed(area) }).collect(),
            crosswalks: polygons(&tables.ped_crossing, &|_| true)
                .into_iter()
                .map(|polygon| Crosswalk { polygon })
                .collect(),
            drivable,
            ..Map::default()
        };
        for (dividers, colour) in
            [(&tables.road_divider, LineColour::Yellow), (&tables.lane_divider, LineColour::White)]
        {
            for divider in dividers {
                let Some(points) = self.line(&divider.line_token) else { continue };
                let word = divider.lane_divider_segments.first().map_or("", |segment| segment.segment_type.as_str());
                let kind = if word.starts_with("DOUBLE") {
                    LineKind::Double
                } else if word.contains("DASHED") || word.contains("ZIGZAG") {
                    LineKind::Dashed
                } else {
                    LineKind::Solid
                };
                let colour = if word.contains("YELLOW") { LineColour::Yellow } else { colour };
                map.line_markings.push(LineMarking { kind, colour, points });
            }
        }
        // Of stop areas, those at lights and signs have a line on the road: the far side of the area's long axis.
        for stop in &tables.stop_line {
            if !matches!(stop.stop_line_type.as_str(), "TRAFFIC_LIGHT" | "STOP_SIGN") {
                continue;
            }
            if let Some(ends) = self.polygon(&stop.polygon_token).and_then(|area| long_axis(&area)) {
                map.stop_lines.push(StopLine { points: ends, light: None });
            }
        }
        for light in &tables.traffic_light {
            let Some(points) = self.line(&light.line_token) else { continue };
            let along = (points[points.len() - 1] - points[0]).try_normalize();
            map.traffic_lights.push(TrafficLight {
                position: points[0].extend(if light.pose.tz > 1.0 { light.pose.tz } else { 4.5 }),
                facing_rad: along.map_or(0.0, |along| along.to_angle()),
                lanes: Vec::new(),
                // The data set does not say what lights show.
                states: vec![LightState::Unknown],
            });
        }
        map
    }

    fn lanes(&self) -> Vec<Lane> {
        let both = [(&self.tables.lane, LaneKind::Road), (&self.tables.lane_connector, LaneKind::Connector)];
        let mut lanes = Vec::new();
        for (rows, kind) in both {
            for row in rows {
                let centre_line = self.tables.arcline_path_3.get(&row.token).map(|arcs| followed(arcs));
                let Some(centre_line) = centre_line.filter(|line| line.len() >= 2 && self.near(line)) else { continue };
                let polygon = if kind == LaneKind::Road { self.polygon(&row.polygon_token) } else { None };
                lanes.push(Lane {
                    name: row.token.clone(),
                    kind,
                    centre_line,
                    polygon: polygon.unwrap_or_default(),
                    speed_limit_mps: None,
                    successors: Vec::new(),
                    predecessors: Vec::new(),
                    left: None,
                    right: None,
                });
            }
        }
        let ids: BTreeMap<String, LaneId> =
            (0..).zip(&lanes).map(|(i, lane): (u32, &Lane)| (lane.name.clone(), LaneId(i))).collect();
        for i in 0..lanes.len() {
            let from = ids[&lanes[i].name];
            let Some(links) = self.tables.connectivity.get(&lanes[i].name) else { continue };
            for to in links.outgoing.iter().filter_map(|token| ids.get(token)) {
                lanes[i].successors.push(*to);
                lanes[to.0 as usize].predecessors.push(from);
            }
        }
        lanes
    }
}

fn closed(polygon: &[DVec2]) -> Vec<DVec2> {
    polygon.iter().chain(polygon.first()).copied().collect()
}

/// Follows arc lines at steps of about a metre.
fn followed(paths: &[Arcs]) -> Vec<DVec2> {
    let mut points: Vec<DVec2> = Vec::new();
    for path in paths {
        let [mut x, mut y, mut heading] = path.start_pose;
        points.push(DVec2::new(x, y));
        for (letter, length_m) in path.shape.chars().zip(path.segment_length) {
            let bend = match letter {
                'L' => 1.0 / path.radius.max(1e-3),
                'R' => -1.0 / path.radius.max(1e-3),
                _ => 0.0,
            };
            if !(length_m > 0.0 && length_m < 1e4) {
                continue;
            }
            let steps = length_m.ceil().max(1.0);
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded above")]
            for _ in 0..steps as usize {
                let (step, turn) = (length_m / steps, bend * length_m / steps);
                // The chord of a short arc lies along its middle heading.
                let direction = DVec2::from_angle(heading + 0.5 * turn);
                (x, y, heading) = (x + direction.x * step, y + direction.y * step, heading + turn);
                points.push(DVec2::new(x, y));
            }
        }
    }
    points.dedup_by(|a, b| a.distance(*b) < 0.05);
    points
}

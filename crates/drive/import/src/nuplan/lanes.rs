//! Lanes, the connectors between them, their links, neighbours and speed limits.
//!
//! A connector leads from the lane that traffic leaves by (`exit_lane_fid`) to the one that it enters
//! (`entry_lane_fid`). Lanes of one direction are neighbours where they share a boundary; bicycle lanes (type 1) are
//! nobody's. Centre lines are the baseline paths.

use std::collections::BTreeMap;

use ds_space::DVec2;
use ds_space::plane::path::{Path, thin};
use ds_world::{Lane, LaneId, LaneKind, Polygon};

use super::package::{Layer, MapError, Row};
use super::{City, Connector, Ground};
use crate::scenarionet::lanes::{HALF_WIDTH_M, Links, link_by_name, widened};

const LANES: Layer = Layer {
    name: "lanes_polygons",
    columns: &["lane_fid", "left_boundary_fid", "right_boundary_fid", "speed_limit_mps"],
    extra: &["lane_type_fid"],
};
const BASELINES: Layer = Layer { name: "baseline_paths", columns: &["lane_fid", "lane_connector_fid"], extra: &[] };
const CONNECTORS: Layer = Layer {
    name: "lane_connectors",
    columns: &["exit_lane_fid", "entry_lane_fid"],
    extra: &["speed_limit_mps", "traffic_light_stop_line_fids"],
};
const CONNECTOR_AREAS: Layer =
    Layer { name: "gen_lane_connectors_scaled_width_polygons", columns: &["lane_connector_fid"], extra: &[] };
const BICYCLES: i64 = 1;

fn lane_name(fid: i64) -> String {
    format!("lane-{fid}")
}

fn connector_name(fid: i64) -> String {
    format!("connector-{fid}")
}

/// Reads lanes and connectors; their surfaces are the first of the drivable areas.
pub(super) fn read(ground: &mut Ground<'_>) -> Result<City, MapError> {
    let mut city = City::default();
    let mut links = Vec::new();
    let baselines = ground.rows(&BASELINES)?;
    let by = |column: usize| -> BTreeMap<i64, &Row> {
        let keyed = baselines.iter().rev().filter_map(|row| Some((row.integer(column)?, row)));
        keyed.collect()
    };
    let (of_lanes, of_connectors) = (by(0), by(1));
    roads(ground, &of_lanes, &mut city, &mut links)?;
    connectors(ground, &of_connectors, &mut city, &mut links)?;
    link_by_name(&mut city.map, &links);
    Ok(city)
}

fn lane(name: String, kind: LaneKind, line: &[DVec2], limit_mps: Option<f64>) -> Option<Lane> {
    let path = Path::new(line)?;
    Some(Lane {
        name,
        kind,
        centre_line: thin(path.points(), 0.005, 6.0),
        polygon: Vec::new(),
        speed_limit_mps: limit_mps.filter(|limit| *limit > 0.5 && *limit < 70.0),
        successors: Vec::new(),
        predecessors: Vec::new(),
        left: None,
        right: None,
    })
}

/// The boundaries of a lane of motor traffic.
struct Sides {
    name: String,
    left: Option<i64>,
    right: Option<i64>,
}

fn roads(
    ground: &mut Ground<'_>,
    baselines: &BTreeMap<i64, &Row>,
    city: &mut City,
    links: &mut Vec<Links>,
) -> Result<(), MapError> {
    let mut indices: BTreeMap<i64, usize> = BTreeMap::new();
    let (mut sides, mut bare) = (Vec::new(), 0);
    for row in ground.rows(&LANES)? {
        let fid = row.integer(0).unwrap_or(row.fid);
        let outlines = ground.outlines(&row);
        let Some(surface) = largest(&outlines) else { continue };
        // A lane may have several polygons: the first is its own, all are drivable.
        city.map.drivable.extend(outlines.iter().cloned());
        if indices.contains_key(&fid) {
            continue;
        }
        let line = baselines.get(&fid).and_then(|row| ground.line(row));
        let made = line.and_then(|line| lane(lane_name(fid), LaneKind::Road, &line, row.real(3)));
        let Some(made) = made else {
            bare += 1;
            continue;
        };
        indices.insert(fid, city.map.lanes.len());
        city.map.lanes.push(Lane { polygon: surface.clone(), ..made });
        let motor = row.integer(4) != Some(BICYCLES);
        let side = |column: usize| row.integer(column).filter(|_| motor);
        sides.push(Sides { name: lane_name(fid), left: side(1), right: side(2) });
    }
    if bare > 0 {
        ground.note(format!("{bare} lanes without a baseline path are left out"));
    }
    links.extend(neighbours(&sides));
    Ok(())
}

/// Returns the largest of some outlines.
fn largest(outlines: &[Polygon]) -> Option<&Polygon> {
    let area = |ring: &Polygon| {
        let next = ring.iter().cycle().skip(1);
        ring.iter().zip(next).map(|(a, b)| (*a - ring[0]).perp_dot(*b - ring[0])).sum::<f64>().abs()
    };
    outlines.iter().max_by(|a, b| area(a).total_cmp(&area(b)))
}

/// Links each lane with the one whose right boundary is its left one, and the other way round.
fn neighbours(sides: &[Sides]) -> Vec<Links> {
    let by = |side: fn(&Sides) -> Option<i64>| -> BTreeMap<i64, &str> {
        sides.iter().filter_map(|lane| Some((side(lane)?, lane.name.as_str()))).collect()
    };
    let (by_left, by_right) = (by(|lane| lane.left), by(|lane| lane.right));
    let name = |found: Option<&&str>| found.map(|name| (*name).to_owned()).into_iter().collect();
    let links = |lane: &Sides| Links {
        left: name(lane.left.and_then(|boundary| by_right.get(&boundary))),
        right: name(lane.right.and_then(|boundary| by_left.get(&boundary))),
        ..Links::default()
    };
    sides.iter().map(links).collect()
}

fn connectors(
    ground: &mut Ground<'_>,
    baselines: &BTreeMap<i64, &Row>,
    city: &mut City,
    links: &mut Vec<Links>,
) -> Result<(), MapError> {
    let mut areas: BTreeMap<i64, Vec<Polygon>> = BTreeMap::new();
    for row in ground.rows_if_any(&CONNECTOR_AREAS)? {
        if let Some(connector) = row.integer(0) {
            areas.entry(connector).or_default().extend(ground.outlines(&row));
        }
    }
    for row in ground.rows(&CONNECTORS)? {
        let line = baselines.get(&row.fid).and_then(|row| ground.line(row)).or_else(|| ground.line(&row));
        let made = line.and_then(|line| lane(connector_name(row.fid), LaneKind::Connector, &line, row.real(2)));
        let Some(mut made) = made else { continue };
        let outlines = areas.remove(&row.fid).unwrap_or_default();
        match largest(&outlines) {
            Some(surface) => {
                made.polygon.clone_from(surface);
                city.map.drivable.extend(outlines.iter().cloned());
            }
            None => {
                city.map.drivable.extend(Path::new(&made.centre_line).map(|path| widened(&path, HALF_WIDTH_M)));
            }
        }
        let (from, to) = (row.integer(0), row.integer(1));
        let name = |lane: Option<i64>| lane.map(lane_name).into_iter().collect();
        links.push(Links { entries: name(from), exits: name(to), ..Links::default() });
        city.connectors.push(Connector {
            fid: row.fid,
            lane: LaneId(u32::try_from(city.map.lanes.len()).unwrap_or(u32::MAX)),
            from: from.unwrap_or(-row.fid),
            stops: row.integers(3),
        });
        city.map.lanes.push(made);
    }
    Ok(())
}

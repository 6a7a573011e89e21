//! What is no lane: junctions, other drivable areas, crosswalks, stop areas, lane lines and road edges.
//!
//! Boundaries of type 0 are dashed lines. Those of type 2 are solid ones where there is road on both sides, else the
//! road's edge; the other types are not painted. The map tells no colours: lines are white. Road edges are the rims of
//! all drivable areas together.

use ds_space::DVec2;
use ds_space::plane::Areas;
use ds_space::plane::path::{Path, thin};
use ds_world::{Crosswalk, LineColour, LineKind, LineMarking, RoadEdge};

use super::package::{Layer, MapError};
use super::{City, Ground, Stop};

const fn plain(name: &'static str) -> Layer {
    Layer { name, columns: &[], extra: &[] }
}

const INTERSECTIONS: Layer = Layer { name: "intersections", columns: &[], extra: &["intersection_type_fid"] };
const CROSSWALKS: Layer = plain("crosswalks");
const STOPS: Layer = Layer { name: "stop_polygons", columns: &["stop_polygon_type_fid"], extra: &[] };
const BOUNDARIES: Layer = Layer { name: "boundaries", columns: &["boundary_type_fid"], extra: &[] };
/// Further drivable areas.
const ROADS: [Layer; 4] =
    [plain("road_segments"), plain("lane_groups_polygons"), plain("generic_drivable_areas"), plain("carpark_areas")];

/// Types of intersections at which lanes only part, join or pass: 3, 4, 5.
const NO_JUNCTIONS: std::ops::RangeInclusive<i64> = 3..=5;
const DASHED: i64 = 0;
const SOLID: i64 = 2;
/// Looks at corners that the lines of a map may cost.
const MOST_LOOKS: usize = 1_000_000_000;

/// Adds the areas and lines of a map whose lanes are read.
pub(super) fn read(ground: &mut Ground<'_>, city: &mut City) -> Result<(), MapError> {
    for row in ground.rows(&INTERSECTIONS)? {
        let outlines = ground.outlines(&row);
        if !row.integer(0).is_some_and(|kind| NO_JUNCTIONS.contains(&kind)) {
            city.map.junctions.extend(outlines.iter().cloned());
        }
        city.map.drivable.extend(outlines);
    }
    for layer in &ROADS {
        for row in ground.rows_if_any(layer)? {
            city.map.drivable.extend(ground.outlines(&row));
        }
    }
    for row in ground.rows(&CROSSWALKS)? {
        city.map.crosswalks.extend(ground.outlines(&row).into_iter().map(|polygon| Crosswalk { polygon }));
    }
    for row in ground.rows(&STOPS)? {
        let kind = row.integer(0).unwrap_or(-1);
        let stops = ground.outlines(&row).into_iter().map(|area| Stop { fid: row.fid, kind, area });
        city.stops.extend(stops);
    }
    lines(ground, city)
}

fn lines(ground: &mut Ground<'_>, city: &mut City) -> Result<(), MapError> {
    let rows = ground.rows(&BOUNDARIES)?;
    let too_large =
        || MapError::TooLarge { layer: "drivable areas".to_owned(), what: "looks at corners", limit: MOST_LOOKS };
    let areas = Areas::new(&city.map.drivable).ok_or_else(too_large)?;
    let (mut markings, mut looks) = (Vec::new(), 0);
    for row in &rows {
        let Some(line) = ground.line(row) else { continue };
        let kind = match row.integer(0) {
            Some(DASHED) => LineKind::Dashed,
            Some(SOLID) if inner(&areas, &line, &mut looks) => LineKind::Solid,
            _ => continue,
        };
        if looks > MOST_LOOKS {
            return Err(too_large());
        }
        markings.push(LineMarking { kind, colour: LineColour::White, points: thin(&line, 0.005, 30.0) });
    }
    let rims = areas.rims().ok_or_else(too_large)?;
    city.map.line_markings = markings;
    city.map.road_edges = rims.into_iter().map(|rim| RoadEdge { points: thin(&rim, 0.01, 30.0) }).collect();
    Ok(())
}

/// Says whether there is road on both sides of most of a line.
fn inner(areas: &Areas<'_>, line: &[DVec2], looks: &mut usize) -> bool {
    let even = Path::new(line).map(|path| path.even(3.0));
    even.is_some_and(|even| areas.inside(even.points(), looks) > 0.5)
}

//! What maps of lane boundaries have in common: centre lines and surfaces between them, edges of the road.

use ds_space::DVec2;
use ds_space::plane::Areas;
use ds_space::plane::path::{Path, thin};
use ds_world::{Polygon, RoadEdge};

use crate::view::FieldFault;

/// Returns an outline without the repetition of its first point.
pub(crate) fn outline(mut points: Vec<DVec2>) -> Polygon {
    while points.len() > 3 && points[0].distance(points[points.len() - 1]) < 1e-3 {
        points.pop();
    }
    points
}

/// Returns the area between two lines, whichever way the second runs.
pub(crate) fn between(one: Vec<DVec2>, mut other: Vec<DVec2>) -> Polygon {
    if (one[one.len() - 1] - one[0]).dot(other[other.len() - 1] - other[0]) > 0.0 {
        other.reverse();
    }
    one.into_iter().chain(other).collect()
}

/// Returns the line midway between two boundaries.
pub(crate) fn midway(left: &[DVec2], right: &[DVec2]) -> Option<Vec<DVec2>> {
    let (left, right) = (Path::new(left)?, Path::new(right)?);
    let count = (left.length_m().max(right.length_m()) / 2.0).ceil().clamp(1.0, 200.0) as usize;
    let point = |i: usize| {
        let share = i as f64 / count as f64;
        left.point(left.length_m() * share).midpoint(right.point(right.length_m() * share))
    };
    Some((0..=count).map(point).collect())
}

/// Returns a line's place in centimetres, the same for both directions.
pub(crate) fn place(points: &[DVec2]) -> Vec<(i64, i64)> {
    let forwards: Vec<(i64, i64)> =
        points.iter().map(|point| ((point.x * 100.0).round() as i64, (point.y * 100.0).round() as i64)).collect();
    let backwards: Vec<(i64, i64)> = forwards.iter().rev().copied().collect();
    forwards.min(backwards)
}

/// Returns the edges of areas beyond which there is no other area.
pub(crate) fn kerbs(areas: &[Polygon]) -> Result<Vec<RoadEdge>, FieldFault> {
    let rims = Areas::new(areas).and_then(|areas| areas.rims()).ok_or_else(|| {
        let corners: usize = areas.iter().map(Vec::len).sum();
        let problem = format!("has {corners} points, too many for the length of the outlines");
        FieldFault { at: "drivable areas".to_owned(), problem }
    })?;
    Ok(rims.into_iter().map(|run| RoadEdge { points: thin(&run, 0.01, 30.0) }).collect())
}

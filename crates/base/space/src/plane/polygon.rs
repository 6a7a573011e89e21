//! Simple polygons as their corners: what they hold, and their long axis. Metres, any fixed frame.
//!
//! A point on the border may count either way; [`super::IndexedPolygon`] is exact there and faster for many points.

use crate::DVec2;

/// Says whether a point lies in a simple polygon (crossing rule; the border may count either way).
#[must_use]
pub fn holds(polygon: &[DVec2], point: DVec2) -> bool {
    let mut inside = false;
    let Some(mut before) = polygon.last() else { return false };
    for vertex in polygon {
        if (vertex.y > point.y) != (before.y > point.y) {
            let share = (point.y - vertex.y) / (before.y - vertex.y);
            if point.x < vertex.x + share * (before.x - vertex.x) {
                inside = !inside;
            }
        }
        before = vertex;
    }
    inside
}

/// Returns the ends of the middle line along a polygon's longest side; none below half a metre.
#[must_use]
pub fn long_axis(polygon: &[DVec2]) -> Option<[DVec2; 2]> {
    let sides = (0..polygon.len()).map(|i| polygon[(i + 1) % polygon.len()] - polygon[i]);
    let along = sides.max_by(|a, b| a.length_squared().total_cmp(&b.length_squared()))?.try_normalize()?;
    let middle = polygon.iter().sum::<DVec2>() / polygon.len() as f64;
    let reach = || polygon.iter().map(|point| (*point - middle).dot(along));
    let (low, high) = (reach().fold(0.0, f64::min), reach().fold(0.0, f64::max));
    (high - low > 0.5).then_some([middle + along * low, middle + along * high])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_polygon_holds_its_inside() {
        let bent =
            [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (2.0, 4.0), (2.0, 2.0), (0.0, 2.0)].map(|(x, y)| DVec2::new(x, y));
        for (x, y, expected) in [(1.0, 1.0, true), (1.0, 3.0, false), (3.0, 3.0, true), (5.0, 1.0, false)] {
            assert_eq!(holds(&bent, DVec2::new(x, y)), expected);
        }
    }
}

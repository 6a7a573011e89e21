//! A union of polygons with bounding boxes: does it hold a point, within a tolerance.

use ds_space::DVec2;
use ds_world::Polygon;

/// Polygons ready for look-up, each grown by the tolerance.
#[derive(Debug, Clone)]
pub(crate) struct Area {
    tolerance_m: f64,
    parts: Vec<Part>,
}

#[derive(Debug, Clone)]
struct Part {
    low: DVec2,
    high: DVec2,
    points: Polygon,
}

impl Area {
    /// Takes all polygons of at least three finite points.
    pub(crate) fn new(polygons: &[Polygon], tolerance_m: f64) -> Self {
        let parts = polygons
            .iter()
            .filter(|points| points.len() >= 3 && points.iter().all(|point| point.is_finite()))
            .map(|points| Part {
                low: points.iter().copied().fold(DVec2::INFINITY, DVec2::min) - tolerance_m,
                high: points.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max) + tolerance_m,
                points: points.clone(),
            })
            .collect();
        Self { tolerance_m, parts }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.parts.is_empty()
    }

    /// Says whether a point lies in a polygon or at most the tolerance outside one.
    pub(crate) fn holds(&self, point: DVec2) -> bool {
        self.parts.iter().any(|part| {
            point.cmpge(part.low).all()
                && point.cmple(part.high).all()
                && (inside(&part.points, point) || near_edge(&part.points, point, self.tolerance_m))
        })
    }
}

fn edges(points: &[DVec2]) -> impl Iterator<Item = (DVec2, DVec2)> {
    let last = points.len() - 1;
    (0..points.len()).map(move |i| (points[if i == 0 { last } else { i - 1 }], points[i]))
}

/// Even-odd rule.
fn inside(points: &[DVec2], point: DVec2) -> bool {
    edges(points).fold(false, |within, (a, b)| {
        let spans = (a.y > point.y) != (b.y > point.y);
        let crosses = spans && point.x < a.x + (point.y - a.y) / (b.y - a.y) * (b.x - a.x);
        within != crosses
    })
}

fn near_edge(points: &[DVec2], point: DVec2, reach_m: f64) -> bool {
    edges(points).any(|(a, b)| {
        let edge = b - a;
        let share = ((point - a).dot(edge) / edge.length_squared().max(1e-12)).clamp(0.0, 1.0);
        (a + edge * share - point).length_squared() <= reach_m * reach_m
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_a_notched_polygon() {
        // A U: 10 x 10 with a notch 4 wide and 6 deep from above.
        let corners = [(0, 0), (10, 0), (10, 10), (7, 10), (7, 4), (3, 4), (3, 10), (0, 10)];
        let points: Polygon = corners.iter().map(|(x, y)| DVec2::new(f64::from(*x), f64::from(*y))).collect();
        for reversed in [false, true] {
            let ring = if reversed { points.iter().rev().copied().collect() } else { points.clone() };
            let area = Area::new(&[ring], 0.1);
            for (x, y, expected) in [
                (1.0, 9.0, true),
                (5.0, 9.0, false),
                (5.0, 2.0, true),
                (5.0, 4.05, true),
                (5.0, 4.2, false),
                (-0.05, 5.0, true),
                (-0.2, 5.0, false),
                (10.0, 10.0, true),
                (f64::NAN, 5.0, false),
            ] {
                assert_eq!(area.holds(DVec2::new(x, y)), expected, "({x}, {y})");
            }
        }
    }

    #[test]
    fn degenerate_polygons_hold_nothing() {
        let line = vec![DVec2::ZERO, DVec2::X];
        let broken = vec![DVec2::ZERO, DVec2::X, DVec2::NAN];
        assert!(Area::new(&[line, broken, Vec::new()], 0.1).is_empty());
    }
}

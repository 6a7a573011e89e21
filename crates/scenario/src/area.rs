//! Plane areas: polygons that hold points, boxes that overlap. Metres.

use ds_space::DVec2;

/// Says whether a point lies in a simple polygon (crossing rule; the border may count either way).
pub(crate) fn holds(polygon: &[DVec2], point: DVec2) -> bool {
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

/// Says whether two boxes given by their corners overlap (separating axes).
pub(crate) fn overlap(a: &[DVec2; 4], b: &[DVec2; 4]) -> bool {
    let apart = |axis: DVec2| {
        let span = |corners: &[DVec2; 4]| {
            corners
                .iter()
                .map(|corner| corner.dot(axis))
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)))
        };
        let ((a_low, a_high), (b_low, b_high)) = (span(a), span(b));
        a_high < b_low || b_high < a_low
    };
    ![a[0] - a[1], a[1] - a[2], b[0] - b[1], b[1] - b[2]].into_iter().any(apart)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_space::PoseSe2;
    use ds_world::agent::corners;

    #[test]
    fn boxes_overlap_only_where_they_meet() {
        let check = |x, y, heading, expected| {
            let a = corners(&PoseSe2::default(), 4.0, 2.0);
            let b = corners(&PoseSe2::new(x, y, heading), 4.0, 2.0);
            assert_eq!(overlap(&a, &b), expected, "{x} {y} {heading}");
            assert_eq!(overlap(&b, &a), expected, "{x} {y} {heading}");
        };
        check(3.9, 0.0, 0.0, true);
        check(4.1, 0.0, 0.0, false);
        check(0.0, 2.9, std::f64::consts::FRAC_PI_2, true);
        check(0.0, 3.1, std::f64::consts::FRAC_PI_2, false);
        check(3.0, 2.0, std::f64::consts::FRAC_PI_4, true);
        check(3.4, 2.6, std::f64::consts::FRAC_PI_4, false);
    }

    #[test]
    fn a_polygon_holds_its_inside() {
        let bent =
            [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (2.0, 4.0), (2.0, 2.0), (0.0, 2.0)].map(|(x, y)| DVec2::new(x, y));
        for (x, y, expected) in [(1.0, 1.0, true), (1.0, 3.0, false), (3.0, 3.0, true), (5.0, 1.0, false)] {
            assert_eq!(holds(&bent, DVec2::new(x, y)), expected);
        }
    }
}

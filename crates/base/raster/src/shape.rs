//! Plane shapes as triangles: simple polygons (concave ones too), ribbons along polylines, dashes, convex hulls.
//!
//! Coordinates are metres in whatever plane the caller means. Broken polygons (self-crossing, repeated points) still
//! give triangles and never fail; what they cover is then not defined.

use ds_space::DVec2;

/// A triangle in the plane.
pub type Triangle = [DVec2; 3];

/// Cuts a simple polygon into triangles by clipping ears; fewer than three distinct points give none.
#[must_use]
pub fn triangulate(polygon: &[DVec2]) -> Vec<Triangle> {
    let mut ring = without_repeats(polygon);
    if signed_area(&ring) < 0.0 {
        ring.reverse();
    }
    let mut triangles = Vec::with_capacity(ring.len());
    let mut start = 0;
    while ring.len() > 3 {
        let ear = next_ear(&ring, start);
        let corners = around(&ring, ear);
        if turn(&corners) > 0.0 {
            triangles.push(corners);
        }
        ring.remove(ear);
        // Going on after the ear, not at it, keeps fans of slivers away.
        start = (ear + 1) % ring.len();
    }
    if let [a, b, c] = ring[..] {
        triangles.push([a, b, c]);
    }
    triangles
}

/// Drops repeated points and points on a straight line between their neighbours (within 5 mm).
fn without_repeats(polygon: &[DVec2]) -> Vec<DVec2> {
    let mut ring: Vec<DVec2> = Vec::with_capacity(polygon.len());
    for point in polygon.iter().filter(|point| point.is_finite()) {
        if ring.last().is_none_or(|last| last.distance_squared(*point) > 1e-8) {
            while ring.len() >= 2 && on_line(ring[ring.len() - 2], ring[ring.len() - 1], *point) {
                ring.pop();
            }
            ring.push(*point);
        }
    }
    while ring.len() > 1 && ring[0].distance_squared(ring[ring.len() - 1]) <= 1e-8 {
        ring.pop();
    }
    ring
}

fn on_line(a: DVec2, b: DVec2, c: DVec2) -> bool {
    let along = c - a;
    let length = along.length();
    length > 1e-6 && (b - a).dot(c - b) > 0.0 && along.perp_dot(b - a).abs() < 1e-4 * length
}

fn around(ring: &[DVec2], i: usize) -> Triangle {
    [ring[(i + ring.len() - 1) % ring.len()], ring[i], ring[(i + 1) % ring.len()]]
}

fn turn([a, b, c]: &Triangle) -> f64 {
    (*b - *a).perp_dot(*c - *b)
}

/// Returns the area of a polygon, negative if it runs clockwise.
#[must_use]
pub fn signed_area(ring: &[DVec2]) -> f64 {
    let origin = ring.first().copied().unwrap_or_default();
    let twice = |i: usize| (ring[i] - origin).perp_dot(ring[(i + 1) % ring.len()] - origin);
    0.5 * (0..ring.len()).map(twice).sum::<f64>()
}

/// Returns the first ear from `start` on, or else the most convex corner.
fn next_ear(ring: &[DVec2], start: usize) -> usize {
    let reflex: Vec<DVec2> = (0..ring.len()).filter(|i| turn(&around(ring, *i)) <= 0.0).map(|i| ring[i]).collect();
    let is_ear = |i: &usize| {
        let corners = around(ring, *i);
        turn(&corners) > 0.0 && !reflex.iter().any(|point| !corners.contains(point) && holds(&corners, *point))
    };
    let order = || (0..ring.len()).map(|i| (start + i) % ring.len());
    order()
        .find(is_ear)
        .or_else(|| order().max_by(|a, b| turn(&around(ring, *a)).total_cmp(&turn(&around(ring, *b)))))
        .unwrap_or(0)
}

fn holds([a, b, c]: &Triangle, p: DVec2) -> bool {
    (*b - *a).perp_dot(p - *a) >= 0.0 && (*c - *b).perp_dot(p - *b) >= 0.0 && (*a - *c).perp_dot(p - *c) >= 0.0
}

/// Shifts a polyline to its left by `left_m`, mitred at the corners (up to twice the distance).
#[must_use]
pub fn shifted(points: &[DVec2], left_m: f64) -> Vec<DVec2> {
    let normal = |i: usize| (points[i + 1] - points[i]).try_normalize().map(DVec2::perp);
    let last = points.len().saturating_sub(1);
    (0..points.len())
        .map(|i| {
            let before = if i > 0 { normal(i - 1) } else { None };
            let after = if i < last { normal(i) } else { None };
            let (a, b) = match (before, after) {
                (Some(a), Some(b)) => (a, b),
                (Some(a), None) | (None, Some(a)) => (a, a),
                (None, None) => return points[i],
            };
            let middle = (a + b).try_normalize().unwrap_or(a);
            points[i] + middle * (left_m / middle.dot(a).max(0.5))
        })
        .collect()
}

/// Returns the strip of a width along a polyline, two triangles a segment.
#[must_use]
pub fn ribbon(points: &[DVec2], width_m: f64) -> Vec<Triangle> {
    let (left, right) = (shifted(points, 0.5 * width_m), shifted(points, -0.5 * width_m));
    (1..points.len()).flat_map(|i| [[right[i - 1], right[i], left[i]], [right[i - 1], left[i], left[i - 1]]]).collect()
}

/// Returns the strip of a width along the outline of a polygon, rounded off by caps at its corners.
#[must_use]
pub fn outline(polygon: &[DVec2], width_m: f64) -> Vec<Triangle> {
    let mut triangles = Vec::with_capacity(4 * polygon.len());
    let half = 0.5 * width_m;
    for (i, from) in polygon.iter().enumerate() {
        let to = polygon[(i + 1) % polygon.len()];
        let Some(along) = (to - *from).try_normalize() else { continue };
        let side = along.perp() * half;
        let (start, end) = (*from - along * (0.4 * half), to + along * (0.4 * half));
        triangles.push([start - side, end - side, end + side]);
        triangles.push([start - side, end + side, start + side]);
    }
    triangles
}

/// Cuts a polyline into dashes of `on_m` with gaps of `off_m`, the first beginning after half a gap.
#[must_use]
pub fn dashes(points: &[DVec2], on_m: f64, off_m: f64) -> Vec<Vec<DVec2>> {
    let mut dashes = Vec::new();
    let mut dash: Vec<DVec2> = Vec::new();
    let (mut drawing, mut left_m) = (false, 0.5 * off_m);
    for pair in points.windows(2) {
        let length = pair[0].distance(pair[1]);
        let mut done = 0.0;
        while length - done > left_m && dashes.len() < 100_000 {
            done += left_m;
            let here = pair[0].lerp(pair[1], done / length);
            if drawing {
                dash.push(here);
                dashes.push(std::mem::take(&mut dash));
            } else {
                dash = vec![here];
            }
            drawing = !drawing;
            left_m = if drawing { on_m } else { off_m };
        }
        left_m -= length - done;
        if drawing {
            dash.push(pair[1]);
        }
    }
    if dash.len() >= 2 {
        dashes.push(dash);
    }
    dashes
}

/// Returns the convex hull of points, counter-clockwise.
#[must_use]
pub fn convex_hull(points: &[DVec2]) -> Vec<DVec2> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    sorted.dedup();
    if sorted.len() < 3 {
        return sorted;
    }
    let mut hull: Vec<DVec2> = Vec::with_capacity(2 * sorted.len());
    let add = |point: DVec2, floor: usize, hull: &mut Vec<DVec2>| {
        while hull.len() >= floor + 2 && turn(&[hull[hull.len() - 2], hull[hull.len() - 1], point]) <= 0.0 {
            hull.pop();
        }
        hull.push(point);
    };
    for point in &sorted {
        add(*point, 0, &mut hull);
    }
    let floor = hull.len() - 1;
    for point in sorted.iter().rev().skip(1) {
        add(*point, floor, &mut hull);
    }
    hull.pop();
    hull
}

/// Returns the triangles of a convex polygon.
pub fn fan(polygon: &[DVec2]) -> impl Iterator<Item = Triangle> + '_ {
    (2..polygon.len()).map(|i| [polygon[0], polygon[i - 1], polygon[i]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn points(coordinates: &[(f64, f64)]) -> Vec<DVec2> {
        coordinates.iter().map(|(x, y)| DVec2::new(*x, *y)).collect()
    }

    fn area(triangles: &[Triangle]) -> f64 {
        triangles.iter().map(|t| 0.5 * turn(t).abs()).sum()
    }

    fn check_area(polygon: &[(f64, f64)], expected: f64) {
        let found = area(&triangulate(&points(polygon)));
        assert!((found - expected).abs() < 1e-9, "{polygon:?}: {found} is not {expected}");
    }

    #[test]
    fn triangles_cover_the_area_of_the_polygon() {
        check_area(&[(0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (0.0, 2.0)], 8.0);
        check_area(&[(0.0, 2.0), (4.0, 2.0), (4.0, 0.0), (0.0, 0.0)], 8.0);
        check_area(&[(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (2.0, 1.0), (0.0, 4.0)], 10.0);
        check_area(&[(0.0, 0.0), (2.0, 0.0), (2.0, 0.0), (4.0, 0.0), (4.0, 1.0), (0.0, 1.0), (0.0, 0.0)], 4.0);
        check_area(&[(0.0, 0.0), (1.0, 0.0)], 0.0);
        check_area(&[], 0.0);
    }

    #[test]
    fn a_bow_tie_gives_triangles_and_ends() {
        assert!(!triangulate(&points(&[(0.0, 0.0), (4.0, 4.0), (4.0, 0.0), (0.0, 4.0), (-1.0, 2.0)])).is_empty());
    }

    #[test]
    fn dashes_have_their_lengths_and_places() {
        let cut = dashes(&points(&[(0.0, 0.0), (5.0, 0.0), (12.0, 0.0)]), 3.0, 2.0);
        let centimetres = |x: f64| (x * 100.0).round() as i64;
        let ends: Vec<_> = cut.iter().map(|d| (centimetres(d[0].x), centimetres(d[d.len() - 1].x))).collect();
        assert_eq!(ends, [(100, 400), (600, 900), (1100, 1200)]);
    }

    proptest! {
        #[test]
        fn a_star_shaped_polygon_is_covered_exactly(radii in proptest::collection::vec(1.0..9.0f64, 5..40)) {
            let corner = |(i, r): (usize, &f64)| DVec2::from_angle(i as f64 / radii.len() as f64 * std::f64::consts::TAU) * *r;
            let ring: Vec<DVec2> = radii.iter().enumerate().map(corner).collect();
            prop_assert!((area(&triangulate(&ring)) - signed_area(&ring)).abs() < 0.05);
        }

        #[test]
        fn a_straight_ribbon_has_the_area_of_its_rectangle(length in 1.0..50.0, width in 0.1..4.0) {
            let strip = ribbon(&[DVec2::ZERO, DVec2::new(0.3 * length, 0.0), DVec2::new(length, 0.0)], width);
            prop_assert!((area(&strip) - length * width).abs() < 1e-9);
        }

        #[test]
        fn the_hull_holds_every_point(coordinates in proptest::collection::vec((-9.0..9.0f64, -9.0..9.0f64), 3..30)) {
            let all = points(&coordinates);
            let hull = convex_hull(&all);
            for point in &all {
                let inside = (0..hull.len()).all(|i| (hull[(i + 1) % hull.len()] - hull[i]).perp_dot(*point - hull[i]) > -1e-9);
                prop_assert!(inside, "{point:?} lies outside");
            }
        }
    }
}

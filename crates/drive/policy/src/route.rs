//! A route as a smooth reference: arc length, heading and curvature along a polyline, and the projection of a pose on it.
//!
//! World frame, metres, radians. Beyond both ends the route goes on straight.

use ds_space::{DVec2, PoseSe2, angle};

/// Half the distance over which headings are averaged, in metres.
const SMOOTHING_M: f64 = 1.5;

/// Where a point lies along a route.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    /// Distance along the route, in metres.
    pub along_m: f64,
    /// Offset to the left of the route, in metres.
    pub left_m: f64,
}

/// A polyline with its arc length.
#[derive(Debug, Clone, PartialEq)]
pub struct Route {
    points: Vec<DVec2>,
    along_m: Vec<f64>,
}

impl Route {
    /// Measures a polyline; points closer than 1 mm to the one before are left out.
    ///
    /// A polyline without two different points becomes a straight line through `start`.
    #[must_use]
    pub fn new(polyline: &[DVec2], start: &PoseSe2) -> Self {
        let mut points: Vec<DVec2> = Vec::with_capacity(polyline.len());
        for point in polyline {
            if points.last().is_none_or(|last| last.distance(*point) > 1e-3) {
                points.push(*point);
            }
        }
        if points.len() < 2 {
            points = vec![start.position, start.position + start.forward()];
        }
        let mut along_m = vec![0.0];
        for pair in points.windows(2) {
            along_m.push(along_m[along_m.len() - 1] + pair[0].distance(pair[1]));
        }
        Self { points, along_m }
    }

    /// Returns the length, in metres.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.along_m[self.along_m.len() - 1]
    }

    /// Returns the point at a distance along the route.
    #[must_use]
    pub fn point(&self, along_m: f64) -> DVec2 {
        let segment = self.segment(along_m);
        let (from, to) = (self.points[segment], self.points[segment + 1]);
        from + (to - from) * ((along_m - self.along_m[segment]) / (self.along_m[segment + 1] - self.along_m[segment]))
    }

    /// Returns the heading at a distance along the route, averaged over a few metres.
    #[must_use]
    pub fn heading_rad(&self, along_m: f64) -> f64 {
        let chord = self.point(along_m + SMOOTHING_M) - self.point(along_m - SMOOTHING_M);
        if chord.length_squared() > 1e-6 { chord.to_angle() } else { self.direction(self.segment(along_m)).to_angle() }
    }

    /// Returns the curvature at a distance along the route, in 1/m, left positive.
    #[must_use]
    pub fn curvature(&self, along_m: f64) -> f64 {
        let before = self.heading_rad(along_m - SMOOTHING_M);
        let after = self.heading_rad(along_m + SMOOTHING_M);
        angle::turn(before, after) / (2.0 * SMOOTHING_M)
    }

    /// Returns the pose on the route at a distance along it.
    #[must_use]
    pub fn pose(&self, along_m: f64) -> PoseSe2 {
        PoseSe2 { position: self.point(along_m), heading_rad: self.heading_rad(along_m) }
    }

    /// Projects a point onto the part of the route between two distances.
    #[must_use]
    pub fn project_within(&self, point: DVec2, from_m: f64, to_m: f64) -> Projection {
        self.nearest(point, self.segment(from_m)..=self.segment(to_m), |_| 0.0)
    }

    /// Projects a point onto the whole route.
    #[must_use]
    pub fn project(&self, point: DVec2) -> Projection {
        self.nearest(point, 0..=self.points.len() - 2, |_| 0.0)
    }

    /// Projects a pose onto the whole route, preferring parts that lead the pose's way.
    #[must_use]
    pub fn project_pose(&self, pose: &PoseSe2) -> Projection {
        let forward = pose.forward();
        self.nearest(pose.position, 0..=self.points.len() - 2, |direction| 4.0 * (1.0 - forward.dot(direction)))
    }

    /// Returns where along the route the line from `a` to `b` crosses it first, if it does.
    #[must_use]
    pub fn crossing(&self, a: DVec2, b: DVec2) -> Option<f64> {
        let line = b - a;
        self.points.windows(2).zip(&self.along_m).find_map(|(pair, along_m)| {
            let way = pair[1] - pair[0];
            let denominator = way.perp_dot(line);
            if denominator.abs() < 1e-12 {
                return None;
            }
            let on_way = (a - pair[0]).perp_dot(line) / denominator;
            let on_line = (a - pair[0]).perp_dot(way) / denominator;
            let inside = (0.0..=1.0).contains(&on_way) && (0.0..=1.0).contains(&on_line);
            inside.then(|| along_m + on_way * way.length())
        })
    }

    fn segment(&self, along_m: f64) -> usize {
        self.along_m.partition_point(|at| *at <= along_m).saturating_sub(1).min(self.points.len() - 2)
    }

    fn direction(&self, segment: usize) -> DVec2 {
        (self.points[segment + 1] - self.points[segment]).normalize_or(DVec2::X)
    }

    fn nearest(
        &self,
        point: DVec2,
        segments: std::ops::RangeInclusive<usize>,
        penalty_m: impl Fn(DVec2) -> f64,
    ) -> Projection {
        let last = self.points.len() - 2;
        let mut best = (f64::INFINITY, Projection { along_m: 0.0, left_m: 0.0 });
        for segment in segments {
            let direction = self.direction(segment);
            let length = self.along_m[segment + 1] - self.along_m[segment];
            let offset = point - self.points[segment];
            let low = if segment == 0 { f64::NEG_INFINITY } else { 0.0 };
            let high = if segment == last { f64::INFINITY } else { length };
            let along = offset.dot(direction).clamp(low, high);
            let distance = (offset - direction * along).length();
            let cost = distance + penalty_m(direction);
            if cost < best.0 {
                let left_m = distance.copysign(direction.perp_dot(offset));
                best = (cost, Projection { along_m: self.along_m[segment] + along, left_m });
            }
        }
        best.1
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn quarter_circle(radius_m: f64) -> Route {
        let points: Vec<DVec2> = (0..=90)
            .map(|k| f64::from(k).to_radians())
            .map(|a| DVec2::new(a.sin(), 1.0 - a.cos()) * radius_m)
            .collect();
        Route::new(&points, &PoseSe2::default())
    }

    #[test]
    fn a_left_curve_has_its_curvature_and_goes_on_straight() {
        let route = quarter_circle(20.0);
        let middle = 0.5 * route.length_m();
        assert!((route.curvature(middle) - 0.05).abs() < 1e-3, "{}", route.curvature(middle));
        assert!((route.heading_rad(middle) - 45f64.to_radians()).abs() < 1e-2);
        let beyond = route.point(route.length_m() + 5.0);
        assert!((beyond - DVec2::new(20.0, 25.0)).length() < 0.1, "{beyond:?}");
    }

    #[test]
    fn a_route_without_length_is_straight_ahead() {
        let route = Route::new(&[DVec2::ZERO, DVec2::ZERO], &PoseSe2::new(3.0, 4.0, 0.0));
        assert!((route.point(7.0) - DVec2::new(10.0, 4.0)).length() < 1e-9);
    }

    proptest! {
        #[test]
        fn projection_inverts_the_offset(along in 3.0..28.0, left in -5.0..5.0) {
            let route = quarter_circle(20.0);
            let on_route = PoseSe2 { position: route.point(along), heading_rad: route.heading_rad(along) };
            let found = route.project(on_route.to_outer(DVec2::new(0.0, left)));
            prop_assert!((found.along_m - along).abs() < 0.1 && (found.left_m - left).abs() < 0.02, "{found:?}");
        }
    }
}

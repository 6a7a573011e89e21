//! A polyline with its arc length: the point at a distance along it, and the projection of a point on it.
//!
//! Planar, metres, frame of its points. Distances are clamped to the ends; the first of equally near segments wins.

use crate::DVec2;

/// A line of at least two distinct finite points.
#[derive(Debug, Clone, PartialEq)]
pub struct Polyline {
    points: Vec<DVec2>,
    arcs_m: Vec<f64>,
}

/// Where a point lies relative to a polyline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    /// Distance along the line of the nearest point on it, in metres.
    pub along_m: f64,
    /// Signed offset from the nearest segment's line, left positive, in metres.
    pub lateral_m: f64,
    /// Distance to the nearest point on the line, in metres.
    pub distance_m: f64,
    /// Index of the nearest segment.
    pub segment: usize,
}

impl Polyline {
    /// Makes a polyline of the points, leaving out repeated ones; `None` if fewer than two distinct ones
    /// remain or a number is not finite.
    #[must_use]
    pub fn new(points: &[DVec2]) -> Option<Self> {
        let mut kept: Vec<DVec2> = Vec::with_capacity(points.len());
        let mut arcs_m = Vec::with_capacity(points.len());
        let mut along_m = 0.0;
        for point in points {
            if !point.is_finite() {
                return None;
            }
            if let Some(last) = kept.last() {
                let step_m = (*point - *last).length();
                if step_m < 1e-9 {
                    continue;
                }
                along_m += step_m;
            }
            kept.push(*point);
            arcs_m.push(along_m);
        }
        (kept.len() >= 2 && along_m.is_finite()).then_some(Self { points: kept, arcs_m })
    }

    /// Returns the distinct points.
    #[must_use]
    pub fn points(&self) -> &[DVec2] {
        &self.points
    }

    /// Returns the distance along the line of each point, in metres.
    #[must_use]
    pub fn arcs_m(&self) -> &[f64] {
        &self.arcs_m
    }

    /// Returns the whole length, in metres.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.arcs_m[self.arcs_m.len() - 1]
    }

    /// Returns the segment that holds a distance along the line.
    #[must_use]
    pub fn segment_at(&self, along_m: f64) -> usize {
        self.arcs_m.partition_point(|arc_m| *arc_m <= along_m).clamp(1, self.points.len() - 1) - 1
    }

    /// Returns the point at a distance along the line, clamped to its ends.
    #[must_use]
    pub fn at(&self, along_m: f64) -> DVec2 {
        let segment = self.segment_at(along_m);
        let (from_m, to_m) = (self.arcs_m[segment], self.arcs_m[segment + 1]);
        let share = ((along_m - from_m) / (to_m - from_m)).clamp(0.0, 1.0);
        self.points[segment].lerp(self.points[segment + 1], share)
    }

    /// Returns the unit direction at a distance along the line.
    #[must_use]
    pub fn direction_at(&self, along_m: f64) -> DVec2 {
        self.direction(self.segment_at(along_m))
    }

    /// Returns the unit direction of a segment.
    ///
    /// # Panics
    /// If there is no such segment.
    #[must_use]
    pub fn direction(&self, segment: usize) -> DVec2 {
        (self.points[segment + 1] - self.points[segment]) / (self.arcs_m[segment + 1] - self.arcs_m[segment])
    }

    /// Returns where a point lies relative to the line.
    #[must_use]
    pub fn project(&self, point: DVec2) -> Projection {
        let mut best = (f64::INFINITY, 0, 0.0);
        for (segment, ends) in self.points.windows(2).enumerate() {
            let edge = ends[1] - ends[0];
            let share = ((point - ends[0]).dot(edge) / edge.length_squared()).clamp(0.0, 1.0);
            let squared = (ends[0] + edge * share - point).length_squared();
            if squared < best.0 {
                best = (squared, segment, share);
            }
        }
        let (squared, segment, share) = best;
        let step_m = self.arcs_m[segment + 1] - self.arcs_m[segment];
        Projection {
            along_m: self.arcs_m[segment] + share * step_m,
            lateral_m: self.direction(segment).perp_dot(point - self.points[segment]),
            distance_m: squared.sqrt(),
            segment,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn corner() -> Polyline {
        let points = [(0.0, 0.0), (0.0, 0.0), (10.0, 0.0), (10.0, 5.0)].map(|(x, y)| DVec2::new(x, y));
        Polyline::new(&points).expect("three distinct points")
    }

    #[test]
    fn refuses_what_has_no_length() {
        assert_eq!(Polyline::new(&[]), None);
        assert_eq!(Polyline::new(&[DVec2::ONE, DVec2::ONE]), None);
        assert_eq!(Polyline::new(&[DVec2::ONE, DVec2::NAN]), None);
    }

    #[test]
    fn points_along_a_corner() {
        for (along_m, x, y) in
            [(-3.0, 0.0, 0.0), (4.0, 4.0, 0.0), (10.0, 10.0, 0.0), (12.0, 10.0, 2.0), (99.0, 10.0, 5.0)]
        {
            assert!((corner().at(along_m) - DVec2::new(x, y)).length() < 1e-12, "at {along_m}");
        }
        assert!((corner().length_m() - 15.0).abs() < 1e-12);
        assert_eq!(corner().direction_at(12.0), DVec2::Y);
    }

    #[test]
    fn projects_points_beside_and_beyond() {
        for (x, y, along_m, lateral_m, distance_m) in [
            (3.0, 2.0, 3.0, 2.0, 2.0),
            (3.0, -1.0, 3.0, -1.0, 1.0),
            (12.0, 4.0, 14.0, -2.0, 2.0),
            (10.0, 8.0, 15.0, 0.0, 3.0),
        ] {
            let got = corner().project(DVec2::new(x, y));
            assert!((got.along_m - along_m).abs() < 1e-12 && (got.lateral_m - lateral_m).abs() < 1e-12, "{got:?}");
            assert!((got.distance_m - distance_m).abs() < 1e-12, "{got:?}");
        }
    }
}

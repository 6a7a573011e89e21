//! Lanes as the closed-loop score sees them: a resampled line with its own coordinates, a surface, and who is best.
//!
//! MD `utils/interpolating_line.py:24-60,108-140`: points are skipped until a segment is longer than 1 m; coordinates are
//! those of the nearest segment, unclamped. Best lane: BS `:164-183`.

use ds_space::DVec2;
use ds_space::angle::turn;
use ds_space::plane::IndexedPolygon;

use super::tick::LoopLane;
use crate::constants::bridgesim::{NO_SEGMENT_M, RESAMPLED_M, SLOW_MPS, STATIC_LINE_M};
use crate::error::ScoreError;

/// A line resampled to segments longer than 1 m.
#[derive(Debug, Clone)]
pub(crate) struct LaneLine {
    segments: Vec<Segment>,
    length_m: f64,
}

#[derive(Debug, Clone, Copy)]
struct Segment {
    start: DVec2,
    end: DVec2,
    direction: DVec2,
    heading_rad: f64,
    before_m: f64,
    length_m: f64,
}

impl LaneLine {
    /// Resamples a line; `None` without a point or with a number that is not finite.
    pub(crate) fn new(points: &[DVec2]) -> Option<Self> {
        if points.is_empty() || !points.iter().all(|point| point.is_finite()) {
            return None;
        }
        let mut line = Self { segments: Vec::new(), length_m: 0.0 };
        let mut from = 0;
        while from + 1 < points.len() {
            let far = |to: &usize| (points[*to] - points[from]).length() > RESAMPLED_M;
            let to = (from + 1..points.len()).find(far).unwrap_or(points.len() - 1);
            if (points[to] - points[from]).length() >= NO_SEGMENT_M {
                line.push(points[from], points[to]);
            }
            from = to;
        }
        if line.segments.is_empty() {
            line.push(points[0], points[0] + DVec2::new(STATIC_LINE_M, 0.0));
        }
        Some(line)
    }

    fn push(&mut self, start: DVec2, end: DVec2) {
        let edge = end - start;
        let length_m = edge.length();
        self.segments.push(Segment {
            start,
            end,
            direction: edge / length_m,
            heading_rad: edge.to_angle(),
            before_m: self.length_m,
            length_m,
        });
        self.length_m += length_m;
    }

    pub(crate) fn length_m(&self) -> f64 {
        self.length_m
    }

    /// Returns distance along and signed offset (left positive) from the nearest segment, both unclamped, in metres.
    pub(crate) fn coordinates(&self, point: DVec2) -> (f64, f64) {
        let mut nearest = (f64::INFINITY, &self.segments[0]);
        for segment in &self.segments {
            let before_m = (segment.start - point).dot(segment.direction);
            let beyond_m = (point - segment.end).dot(segment.direction);
            let along_m = before_m.max(beyond_m).max(0.0);
            let distance_m = along_m.hypot(segment.direction.perp_dot(point - segment.start));
            if distance_m < nearest.0 {
                nearest = (distance_m, segment);
            }
        }
        let (_, segment) = nearest;
        let offset = point - segment.start;
        (segment.before_m + offset.dot(segment.direction), segment.direction.perp_dot(offset))
    }

    /// Returns the heading at a distance along, clamped to the line.
    pub(crate) fn heading_at(&self, along_m: f64) -> f64 {
        let along_m = along_m.min(self.length_m).max(0.0);
        let holds = |segment: &&Segment| segment.before_m + segment.length_m > along_m;
        self.segments.iter().find(holds).unwrap_or(&self.segments[self.segments.len() - 1]).heading_rad
    }
}

/// A lane ready for look-ups.
#[derive(Debug, Clone)]
pub(crate) struct IndexedLane {
    pub(crate) line: LaneLine,
    pub(crate) surface: IndexedPolygon,
    pub(crate) connector: bool,
    pub(crate) on_route: bool,
}

impl IndexedLane {
    pub(crate) fn new(index: usize, lane: &LoopLane) -> Result<Self, ScoreError> {
        let line = LaneLine::new(&lane.line)
            .ok_or_else(|| ScoreError::BadPolygon { field: format!("lanes[{index}].line") })?;
        let surface = IndexedPolygon::new(&lane.outline, &[])
            .ok_or_else(|| ScoreError::BadPolygon { field: format!("lanes[{index}].outline") })?;
        Ok(Self { line, surface, connector: lane.connector, on_route: lane.on_route })
    }
}

/// Returns the lanes whose bounds, grown by a radius, hold a point, in map order.
pub(crate) fn near(lanes: &[IndexedLane], point: DVec2, radius_m: f64) -> impl Iterator<Item = (usize, &IndexedLane)> {
    lanes.iter().enumerate().filter(move |(_, lane)| lane.surface.bounds().reaches(point, radius_m))
}

/// The ego's place in a lane.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    pub(crate) lateral_m: f64,
    /// How far the heading is turned away from the lane's, in radians.
    pub(crate) turned_rad: f64,
}

/// Returns the nearest lane near by that leads the ego's way; any lane if the ego is slow.
pub(crate) fn best(
    lanes: &[IndexedLane],
    point: DVec2,
    heading_rad: f64,
    speed_mps: f64,
    radius_m: f64,
) -> Option<Place> {
    let mut best: Option<(f64, Place)> = None;
    for (_, lane) in near(lanes, point, radius_m) {
        let (along_m, lateral_m) = lane.line.coordinates(point);
        let turned_rad = turn(lane.line.heading_at(along_m), heading_rad).abs();
        if speed_mps >= SLOW_MPS && turned_rad >= std::f64::consts::FRAC_PI_2 {
            continue;
        }
        let distance_m = lateral_m.abs() + (along_m - lane.line.length_m()).max(0.0) + (-along_m).max(0.0);
        if best.is_none_or(|(least_m, _)| distance_m < least_m) {
            best = Some((distance_m, Place { lateral_m, turned_rad }));
        }
    }
    best.map(|(_, place)| place)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(points: &[(f64, f64)]) -> LaneLine {
        LaneLine::new(&points.iter().map(|(x, y)| DVec2::new(*x, *y)).collect::<Vec<_>>()).expect("a line")
    }

    #[test]
    fn short_steps_are_merged() {
        let got = line(&[(0.0, 0.0), (0.4, 0.0), (1.0, 0.0), (1.2, 0.0), (1.2, 3.0), (1.2, 3.5)]);
        // 0 → 1.2 (1.0 is not longer than 1 m), → 3.0, → 3.5 (the rest).
        let lengths: Vec<f64> = got.segments.iter().map(|segment| segment.length_m).collect();
        assert_eq!(lengths, [1.2, 3.0, 0.5]);
        assert!((got.length_m() - 4.7).abs() < 1e-12);
    }

    #[test]
    fn coordinates_are_unclamped() {
        let got = line(&[(0.0, 0.0), (10.0, 0.0), (10.0, 10.0)]);
        for (x, y, along_m, lateral_m) in
            [(-3.0, 1.0, -3.0, 1.0), (4.0, -2.0, 4.0, -2.0), (9.0, 5.0, 15.0, 1.0), (10.0, 14.0, 24.0, 0.0)]
        {
            let (along, lateral) = got.coordinates(DVec2::new(x, y));
            assert!(
                (along - along_m).abs() < 1e-12 && (lateral - lateral_m).abs() < 1e-12,
                "({x}, {y}): {along} {lateral}"
            );
        }
        assert_eq!((got.heading_at(-1.0), got.heading_at(9.9)), (0.0, 0.0));
        assert!((got.heading_at(10.0) - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    }

    #[test]
    fn a_point_is_a_line_of_ten_centimetres() {
        assert!((line(&[(5.0, 5.0), (5.0, 5.0)]).length_m() - 0.1).abs() < 1e-12);
        assert!(LaneLine::new(&[]).is_none());
    }
}

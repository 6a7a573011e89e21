//! A polyline with its arc length and boxes around runs of segments, for the nearest point on it.
//!
//! Distances along are clamped to the ends; the first of equally near segments wins, as in GEOS.

use std::ops::Deref;

use super::{Bounds, Polyline};
use crate::DVec2;

const RUN: usize = 8;

/// A line of at least two distinct finite points. Any fixed frame, metres.
#[derive(Debug, Clone)]
pub struct Line {
    polyline: Polyline,
    runs: Vec<Bounds>,
}

impl Deref for Line {
    type Target = Polyline;

    fn deref(&self) -> &Polyline {
        &self.polyline
    }
}

/// The nearest point on a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    /// Its distance along the line, in metres.
    pub along_m: f64,
    /// Squared distance to it, in square metres.
    pub distance_squared: f64,
    /// The segment it lies on.
    pub segment: usize,
}

impl Line {
    /// Prepares a line, leaving out repeated points; `None` if fewer than two distinct ones remain or a number is
    /// not finite.
    #[must_use]
    pub fn new(points: &[DVec2]) -> Option<Self> {
        let polyline = Polyline::new(points)?;
        let kept = polyline.points();
        let runs = (0..kept.len() - 1).step_by(RUN).map(|i| Bounds::of(&kept[i..(i + RUN + 1).min(kept.len())]));
        Some(Self { runs: runs.collect(), polyline })
    }

    /// Returns the nearest point on the line.
    #[must_use]
    pub fn nearest(&self, point: DVec2) -> Nearest {
        self.nearest_from(point, 0)
    }

    /// As [`Self::nearest`], faster if the segment `hint` is near the answer.
    #[must_use]
    pub fn nearest_from(&self, point: DVec2, hint: usize) -> Nearest {
        let first_run = (hint / RUN).min(self.runs.len() - 1);
        let mut best = Nearest { along_m: 0.0, distance_squared: f64::INFINITY, segment: usize::MAX };
        self.search_run(first_run, point, &mut best);
        for run in 0..self.runs.len() {
            if run != first_run && self.runs[run].distance_squared(point) <= best.distance_squared {
                self.search_run(run, point, &mut best);
            }
        }
        best
    }

    fn search_run(&self, run: usize, point: DVec2, best: &mut Nearest) {
        let last = ((run + 1) * RUN).min(self.points().len() - 1);
        for segment in run * RUN..last {
            let from = self.points()[segment];
            let edge = self.points()[segment + 1] - from;
            let share = ((point - from).dot(edge) / edge.length_squared()).clamp(0.0, 1.0);
            let distance_squared = (from + edge * share - point).length_squared();
            let earlier = distance_squared == best.distance_squared && segment < best.segment;
            if distance_squared < best.distance_squared || earlier {
                let step_m = self.arcs_m()[segment + 1] - self.arcs_m()[segment];
                *best = Nearest { along_m: self.arcs_m()[segment] + share * step_m, distance_squared, segment };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn projects_points_beside_and_beyond() {
        let corner = [(0.0, 0.0), (0.0, 0.0), (10.0, 0.0), (10.0, 5.0)].map(|(x, y)| DVec2::new(x, y));
        let line = Line::new(&corner).expect("three distinct points");
        for (x, y, along_m, distance_m) in [
            (3.0, 2.0, 3.0, 2.0),
            (-3.0, 4.0, 0.0, 5.0),
            (12.0, 4.0, 14.0, 2.0),
            (10.0, 8.0, 15.0, 3.0),
            (9.0, 1.0, 9.0, 1.0),
        ] {
            let got = line.nearest(DVec2::new(x, y));
            assert!((got.along_m - along_m).abs() < 1e-12, "{got:?}");
            assert!((got.distance_squared.sqrt() - distance_m).abs() < 1e-12, "{got:?}");
        }
        assert!(Line::new(&[DVec2::ONE, DVec2::ONE]).is_none());
        assert!(Line::new(&[DVec2::ONE, DVec2::NAN]).is_none());
    }

    proptest! {
        #[test]
        fn runs_and_hints_change_nothing(
            turns in prop::collection::vec(-0.5..0.5f64, 2..90), x in -40.0..40.0f64, y in -40.0..40.0f64, hint in 0usize..120,
        ) {
            let mut points = vec![DVec2::ZERO];
            let mut heading = 0.0;
            for turn in &turns {
                heading += turn;
                points.push(points[points.len() - 1] + DVec2::from_angle(heading));
            }
            let line = Line::new(&points).expect("a line");
            let point = DVec2::new(x, y);
            let plain = Polyline::new(&points).expect("a line").project(point);
            let got = line.nearest_from(point, hint);
            prop_assert_eq!(got.segment, plain.segment);
            prop_assert!((got.along_m - plain.along_m).abs() < 1e-9);
        }
    }
}

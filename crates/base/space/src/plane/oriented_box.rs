//! A rectangle with a heading: the footprint of a vehicle or object. Touching is tested on separating axes, closed.

use super::Bounds;
use crate::{DVec2, PoseSe2};

/// A rectangle around its centre. World frame, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrientedBox {
    /// The centre.
    pub centre: DVec2,
    /// The unit vector along the heading.
    pub forward: DVec2,
    /// Half the length, along the heading, in metres.
    pub half_length_m: f64,
    /// Half the width, across the heading, in metres.
    pub half_width_m: f64,
}

impl OrientedBox {
    /// Makes the box of a length and width around the pose of its centre.
    #[must_use]
    pub fn new(centre: &PoseSe2, length_m: f64, width_m: f64) -> Self {
        Self {
            centre: centre.position,
            forward: centre.forward(),
            half_length_m: 0.5 * length_m,
            half_width_m: 0.5 * width_m,
        }
    }

    /// Returns the corners: front left, rear left, rear right, front right.
    #[must_use]
    pub fn corners(&self) -> [DVec2; 4] {
        let (along, across) = (self.forward * self.half_length_m, self.forward.perp() * self.half_width_m);
        let (front, rear) = (self.centre + along, self.centre - along);
        [front + across, rear + across, rear - across, front - across]
    }

    /// Returns the front edge, from left to right.
    #[must_use]
    pub fn front_edge(&self) -> [DVec2; 2] {
        let corners = self.corners();
        [corners[0], corners[3]]
    }

    /// Returns the box moved by an offset in metres.
    #[must_use]
    pub fn moved(&self, offset: DVec2) -> Self {
        Self { centre: self.centre + offset, ..*self }
    }

    /// Returns the smallest axis-aligned box around it.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        let reach = DVec2::new(
            self.half_length_m * self.forward.x.abs() + self.half_width_m * self.forward.y.abs(),
            self.half_length_m * self.forward.y.abs() + self.half_width_m * self.forward.x.abs(),
        );
        Bounds { low: self.centre - reach, high: self.centre + reach }
    }

    /// Returns the squared radius of the circle around the box, in square metres.
    #[must_use]
    pub fn radius_squared(&self) -> f64 {
        self.half_length_m * self.half_length_m + self.half_width_m * self.half_width_m
    }

    /// Says whether the closed boxes share a point.
    #[must_use]
    pub fn touches(&self, other: &Self) -> bool {
        let offset = other.centre - self.centre;
        // (r + s)² ≤ 2 (r² + s²): no root needed to leave out what is far away.
        if offset.length_squared() > 2.0 * (self.radius_squared() + other.radius_squared()) {
            return false;
        }
        let cos = self.forward.dot(other.forward).abs();
        let sin = self.forward.perp_dot(other.forward).abs();
        let along = |a: &Self, b: &Self| a.half_length_m + b.half_length_m * cos + b.half_width_m * sin;
        let across = |a: &Self, b: &Self| a.half_width_m + b.half_length_m * sin + b.half_width_m * cos;
        offset.dot(self.forward).abs() <= along(self, other)
            && offset.perp_dot(self.forward).abs() <= across(self, other)
            && offset.dot(other.forward).abs() <= along(other, self)
            && offset.perp_dot(other.forward).abs() <= across(other, self)
    }

    /// Says whether a closed segment shares a point with the closed box.
    #[must_use]
    pub fn touches_segment(&self, segment: [DVec2; 2]) -> bool {
        let local = segment.map(|point| {
            let offset = point - self.centre;
            DVec2::new(offset.dot(self.forward), self.forward.perp_dot(offset))
        });
        let half = DVec2::new(self.half_length_m, self.half_width_m);
        let low = local[0].min(local[1]);
        let high = local[0].max(local[1]);
        if low.x > half.x || high.x < -half.x || low.y > half.y || high.y < -half.y {
            return false;
        }
        let edge = local[1] - local[0];
        edge.perp_dot(local[0]).abs() <= half.x * edge.y.abs() + half.y * edge.x.abs()
    }
}

/// Says whether two boxes given by their corners overlap (separating axes).
#[must_use]
pub fn overlap(a: &[DVec2; 4], b: &[DVec2; 4]) -> bool {
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

    fn at(x_m: f64, y_m: f64, heading_rad: f64) -> OrientedBox {
        OrientedBox::new(&PoseSe2::new(x_m, y_m, heading_rad), 4.0, 2.0)
    }

    #[test]
    fn boxes_by_table() {
        let quarter = std::f64::consts::FRAC_PI_4;
        for (other, expected) in [
            (at(4.0, 0.0, 0.0), true),
            (at(4.0 + 1e-9, 0.0, 0.0), false),
            (at(4.0, 2.0, 0.0), true),
            (at(0.0, 2.0, 0.0), true),
            (at(0.0, -2.000_001, 0.0), false),
            (at(1.0, 0.3, 2.0), true),
            // Turned by 45°, half its diagonal extent is (2 + 1) / √2.
            (at(2.0 + 3.0 / 2.0f64.sqrt() - 1e-9, 0.0, quarter), true),
            (at(2.0 + 3.0 / 2.0f64.sqrt() + 1e-9, 0.0, quarter), false),
            (at(3.6, 2.6, quarter), false),
            (at(3.2, 2.2, quarter), true),
        ] {
            assert_eq!(at(0.0, 0.0, 0.0).touches(&other), expected, "{other:?}");
            assert_eq!(other.touches(&at(0.0, 0.0, 0.0)), expected, "{other:?}");
        }
    }

    #[test]
    fn segments_by_table() {
        let point = |x: f64, y: f64| DVec2::new(x, y);
        for (a, b, expected) in [
            (point(2.0, -5.0), point(2.0, 5.0), true),
            (point(2.1, -5.0), point(2.1, 5.0), false),
            (point(0.0, 0.0), point(0.1, 0.1), true),
            (point(1.0, 2.0), point(3.0, 0.0), true),
            (point(1.1, 2.0), point(3.1, 0.0), false),
            (point(5.0, 5.0), point(5.0, 5.0), false),
        ] {
            assert_eq!(at(0.0, 0.0, 0.0).touches_segment([a, b]), expected, "{a} {b}");
        }
    }

    #[test]
    fn corners_go_round_from_front_left() {
        let corners = at(10.0, 0.0, std::f64::consts::FRAC_PI_2).corners();
        let expected = [(9.0, 2.0), (9.0, -2.0), (11.0, -2.0), (11.0, 2.0)];
        for (corner, (x, y)) in corners.iter().zip(expected) {
            assert!((*corner - DVec2::new(x, y)).length() < 1e-12, "{corners:?}");
        }
    }

    #[test]
    fn boxes_overlap_only_where_they_meet() {
        let check = |x, y, heading, expected| {
            let a = at(0.0, 0.0, 0.0).corners();
            let b = at(x, y, heading).corners();
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
}

//! Axis-aligned bounding boxes, closed.

use crate::DVec2;

/// An axis-aligned box; empty if `low` exceeds `high`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// The lower left corner, in metres.
    pub low: DVec2,
    /// The upper right corner, in metres.
    pub high: DVec2,
}

impl Bounds {
    /// The box without any point.
    pub const EMPTY: Self = Self { low: DVec2::INFINITY, high: DVec2::NEG_INFINITY };

    /// Returns the smallest box that holds all points.
    #[must_use]
    pub fn of(points: &[DVec2]) -> Self {
        points.iter().fold(Self::EMPTY, |bounds, point| bounds.with(*point))
    }

    /// Returns the smallest box that holds this one and a point.
    #[must_use]
    pub fn with(self, point: DVec2) -> Self {
        Self { low: self.low.min(point), high: self.high.max(point) }
    }

    /// Returns the smallest box that holds both.
    #[must_use]
    pub fn union(self, other: &Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// Returns the box with every side moved outwards.
    #[must_use]
    pub fn grown(self, by_m: f64) -> Self {
        Self { low: self.low - by_m, high: self.high + by_m }
    }

    /// Says whether the closed boxes share a point.
    #[must_use]
    pub fn overlaps(&self, other: &Self) -> bool {
        self.low.x <= other.high.x
            && other.low.x <= self.high.x
            && self.low.y <= other.high.y
            && other.low.y <= self.high.y
    }

    /// Says whether a point lies in the closed box.
    #[must_use]
    pub fn holds(&self, point: DVec2) -> bool {
        self.low.x <= point.x && point.x <= self.high.x && self.low.y <= point.y && point.y <= self.high.y
    }

    /// Says whether a point lies strictly inside the box after moving its sides outwards.
    #[must_use]
    pub fn reaches(&self, point: DVec2, radius_m: f64) -> bool {
        self.low.x - radius_m < point.x
            && point.x < self.high.x + radius_m
            && self.low.y - radius_m < point.y
            && point.y < self.high.y + radius_m
    }

    /// Returns the squared distance from a point to the closed box, in square metres.
    #[must_use]
    pub fn distance_squared(&self, point: DVec2) -> f64 {
        (point.clamp(self.low, self.high) - point).length_squared()
    }

    /// Says whether the box holds no point.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        !(self.low.x <= self.high.x && self.low.y <= self.high.y)
    }
}

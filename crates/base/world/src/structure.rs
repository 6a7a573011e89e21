//! What stands beside the road and never moves: extruded outlines with a kind, without any look.

use ds_space::{DVec2, DVec3, PoseSe2};

/// What a structure is. The order stays: digests of scenes count by it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum StructureKind {
    /// A house or hall.
    Building,
    /// A tree, bush or hedge.
    Vegetation,
    /// A pole, post or mast.
    Pole,
    /// A fence or guard rail.
    Fence,
    /// A free-standing wall.
    Wall,
}

impl StructureKind {
    /// All kinds.
    pub const ALL: [Self; 5] = [Self::Building, Self::Vegetation, Self::Pole, Self::Fence, Self::Wall];
}

/// An upright prism over an outline on the ground, world frame, in metres.
#[derive(Debug, Clone, PartialEq)]
pub struct Structure {
    /// What it is.
    pub kind: StructureKind,
    /// Outline of at least three points; the first edge of a building faces the road where its source knows.
    pub outline: Vec<DVec2>,
    /// Height of its lower end over the ground: 0 but for crowns of trees and the like.
    pub bottom_m: f64,
    /// Height of its upper end over the ground.
    pub top_m: f64,
}

impl Structure {
    /// Raises a box around a place, half as deep and half as wide as told in metres, its first edge in front.
    #[must_use]
    pub fn cuboid(kind: StructureKind, place: PoseSe2, [deep, wide]: [f64; 2], [bottom_m, top_m]: [f64; 2]) -> Self {
        let corners = [(deep, -wide), (deep, wide), (-deep, wide), (-deep, -wide)];
        Self { kind, outline: corners.map(|(x, y)| place.to_outer(DVec2::new(x, y))).to_vec(), bottom_m, top_m }
    }

    /// Returns what keys its draws: its place to a decimetre, not its number, so that what is taken away changes nothing else.
    #[must_use]
    pub fn key(&self) -> [u64; 2] {
        self.centre().to_array().map(|at| (10.0 * at).round().to_bits())
    }

    /// Returns the middle of the outline's corners.
    #[must_use]
    pub fn centre(&self) -> DVec2 {
        self.outline.iter().sum::<DVec2>() / self.outline.len().max(1) as f64
    }

    /// Returns how far the outline reaches from its centre, in metres.
    #[must_use]
    pub fn reach_m(&self) -> f64 {
        let centre = self.centre();
        self.outline.iter().map(|corner| corner.distance(centre)).fold(0.0, f64::max)
    }

    /// Returns the ball that holds all of it from the ground up: its middle and radius in metres.
    #[must_use]
    pub fn ball(&self) -> (DVec3, f64) {
        (self.centre().extend(0.5 * self.top_m), self.reach_m().hypot(0.5 * self.top_m))
    }
}

//! The parts of a frame: what each pixel shows, told from the layout's colour there, and frames with one part of another.
//!
//! Every pixel is of one part. People, vehicles and cones have a border of one pixel, taken from what is beside them: their
//! edges in a frame lie a little beside those in the layout.

use ds_layout::colour::{self, Rgb};
use ds_raster::RgbImage;

/// A part of a frame; those with a border first, in the order in which they take pixels from others.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Part {
    /// Pedestrians and cyclists.
    People,
    /// Vehicles.
    Vehicles,
    /// Cones and barriers.
    Cones,
    /// Painted lines and crossings.
    Paint,
    /// What stands beside the road.
    Structures,
    /// The sky.
    Sky,
    /// Ground off the road.
    Ground,
    /// The edge of the road.
    Edge,
    /// Light heads and the stop lines that they govern.
    Lights,
    /// Bare road.
    Surface,
}

impl Part {
    /// How many there are.
    pub(super) const COUNT: usize = 10;

    /// All parts.
    pub(super) const ALL: [Self; Self::COUNT] = [
        Self::People,
        Self::Vehicles,
        Self::Cones,
        Self::Paint,
        Self::Structures,
        Self::Sky,
        Self::Ground,
        Self::Edge,
        Self::Lights,
        Self::Surface,
    ];

    /// Returns its name in tables.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::People => "people",
            Self::Vehicles => "vehicles",
            Self::Cones => "cones and barriers",
            Self::Paint => "paint",
            Self::Structures => "structures",
            Self::Sky => "sky",
            Self::Ground => "ground",
            Self::Edge => "road edge",
            Self::Lights => "lights and stop lines",
            Self::Surface => "road surface",
        }
    }

    /// Returns the part that a colour of the layout tells of; light heads have all colours that nothing else has.
    fn told(colour: Rgb) -> Self {
        match colour {
            colour::SKY => Self::Sky,
            colour::GROUND => Self::Ground,
            colour::ROAD_EDGE => Self::Edge,
            _ if colour::is_surface(colour) => Self::Surface,
            _ if colour::is_person(colour) => Self::People,
            _ if colour::is_road_user(colour) => Self::Vehicles,
            _ if colour::is_marking(colour) => Self::Paint,
            _ if colour::is_structure(colour) => Self::Structures,
            _ if colour::is_obstacle(colour) => Self::Cones,
            _ => Self::Lights,
        }
    }

    fn has_border(self) -> bool {
        self <= Self::Cones
    }
}

/// Returns the part of every pixel of a frame with this layout.
pub(super) fn of(layout: &RgbImage) -> Vec<Part> {
    let (width, height) = (layout.width_px() as usize, layout.height_px() as usize);
    let own: Vec<Part> = layout.rgb().as_chunks().0.iter().map(|colour| Part::told(*colour)).collect();
    let bordered = |at: usize| {
        let (x, y) = (at % width, at / width);
        let beside = [
            (x > 0).then(|| own[at - 1]),
            (x + 1 < width).then(|| own[at + 1]),
            (y > 0).then(|| own[at - width]),
            (y + 1 < height).then(|| own[at + width]),
        ];
        beside.into_iter().flatten().filter(|part| part.has_border()).fold(own[at], Part::min)
    };
    (0..own.len()).map(bordered).collect()
}

/// Returns the share of each part in a frame, in the order of all parts.
pub(super) fn shares(parts: &[Part]) -> [f64; Part::COUNT] {
    Part::ALL.map(|part| parts.iter().filter(|of| **of == part).count() as f64 / parts.len().max(1) as f64)
}

/// Returns a frame with one part of another frame of the same size.
pub(super) fn pasted(onto: &RgbImage, from: &RgbImage, parts: &[Part], part: Part) -> RgbImage {
    let mut pasted = onto.clone();
    let pixels = pasted.rgb_mut().chunks_exact_mut(3).zip(from.rgb().chunks_exact(3));
    for ((to, from), _) in pixels.zip(parts).filter(|(_, of)| **of == part) {
        to.copy_from_slice(from);
    }
    pasted
}

#[cfg(test)]
mod tests;

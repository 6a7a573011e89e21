//! What a pixel of a camera's picture belongs to; segmenters learn these.

/// What a pixel belongs to: the ground truth for a segmenter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum PixelClass {
    /// Drivable surface.
    Road = 0,
    /// Lane lines, stop lines and crosswalk bars.
    Paint = 1,
    /// Cars, trucks, buses.
    Vehicle = 2,
    /// Pedestrians, and cyclists with their bicycles.
    Person = 3,
    /// Everything else below the sky: verge, houses, trees, lights, cones, barriers.
    Other = 4,
    /// The sky.
    Sky = 5,
}

impl PixelClass {
    /// Number of classes.
    pub const COUNT: usize = 6;
}

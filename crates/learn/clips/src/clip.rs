//! A clip in memory.

use ds_raster::RgbImage;

/// Consecutive ticks of a drive as pictures.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Clip {
    /// What the camera saw; clips of edited first frames hold tick 0 alone.
    pub frames: Vec<RgbImage>,
    /// The layouts of the same ticks.
    pub layouts: Vec<RgbImage>,
    /// Per frame the class of each pixel (`ds_camera::PixelClass` as a number), rows top to bottom; empty if not kept.
    pub classes: Vec<Vec<u8>>,
    /// What the drive looks like, in words.
    pub prompt: String,
}

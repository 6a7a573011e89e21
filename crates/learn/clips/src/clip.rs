//! A clip in memory.

use std::sync::Arc;

use ds_raster::{Geometry, RgbImage};

/// Consecutive ticks of a drive as pictures.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Clip {
    /// What the camera saw; clips of edited first frames hold tick 0 alone.
    pub frames: Vec<RgbImage>,
    /// The layouts of the same ticks.
    pub layouts: Vec<RgbImage>,
    /// Their geometry; empty in sets made without it.
    pub geometry: Vec<Arc<Geometry>>,
    /// Per frame the class of each pixel (`ds_camera::PixelClass` as a number), rows top to bottom; empty if not kept.
    pub classes: Vec<Vec<u8>>,
    /// What the drive looks like, in words.
    pub prompt: String,
}

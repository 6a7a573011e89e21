//! Pixel buffers with their meaning, lossless encodings, digests, and a z-buffered software rasteriser.
//!
//! Images are 8-bit RGB in sRGB, rows top to bottom, no padding. The rasteriser is shared by the layout's `cpu`
//! back end and the reference camera; it knows triangles and depth, not scenes.

pub mod depth;
pub mod encode;
pub mod image;

pub use depth::DepthRaster;
pub use encode::{Encoding, ImageError};
pub use image::RgbImage;

//! Pixel buffers with their meaning, lossless encodings, digests, a z-buffered software rasteriser, and what falls before a camera.
//!
//! Images are 8-bit RGB in sRGB, rows top to bottom, no padding. The rasteriser is shared by the layout's `cpu`
//! back end and the reference camera; it knows triangles, views, lenses and depth, not scenes.

mod alike;
mod class;
pub mod depth;
mod detail;
pub mod encode;
pub mod fall;
pub mod geometry;
pub mod image;
pub mod lens;
mod paint;
mod photo;
pub mod shape;
mod values;
pub mod view;

pub use class::PixelClass;
pub use depth::{DepthRaster, ScreenPoint};
pub use detail::{calmed, sharpened};
pub use encode::Encoding;
pub use fall::{Fall, Falling, Sight, cleared};
pub use geometry::{Air, Carried, Geometry, INVERSE_DEPTH_STEP, Mover};
pub use image::{ImageError, RgbImage};
pub use lens::Lens;
pub use paint::{Paints, paints};
pub use values::value;
pub use view::View;

//! Layout images: map, lights and boxes seen by a camera, as the condition of the video model.
//!
//! One scene description ([`LayoutScene`]), two back ends: `cpu` (software rasteriser, bit-reproducible) and `wgpu`
//! (any Vulkan or GL adapter). Both paint the ground layers in a fixed order, test boxes by depth and cut at the near
//! plane. World frame, metres; colours in [`colour`]. Never sees a frame; the ego vehicle is not drawn.

pub mod colour;
mod cpu;
mod error;
mod geometry;
mod gpu;
mod renderer;
mod scene;

pub use ds_world::LayoutBackend;
pub use error::LayoutError;
pub use geometry::carriable;
pub use renderer::Renderer;
pub use scene::{LayoutScene, RANGE_M, Shot, StaticMap};

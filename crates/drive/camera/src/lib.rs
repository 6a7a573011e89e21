//! Cameras of the project's own: the rich *reference* camera, the *plain* one, and the class map of their pixels.
//!
//! Each is a pure function of scene, world state, camera and appearance, rendered in software: same input, same bits.
//! World frame, metres. Random choices are keyed by the scene's digest and the appearance's palette.

mod appearance;
mod cover;
mod fall;
mod figure;
mod geometry;
mod ground;
mod light;
mod look;
mod noise;
mod plain;
mod reference;
mod reprojected;
mod scene_camera;
mod shade;
mod solid;
mod surface;
mod surroundings;
mod texture;
mod vehicle;
mod world;

#[cfg(test)]
#[path = "../../layout/tests/scenes/street.rs"]
#[expect(dead_code, reason = "the unit tests need the scene alone")]
mod street;

pub use appearance::{Appearance, UnknownAppearance};
pub use ds_raster::PixelClass;
pub use ds_world::{Condition, ConditionError, Lighting, RoadSurface, Weather};
pub use plain::PlainCamera;
pub use reference::{ReferenceCamera, Sampling};
pub use reprojected::ReprojectedCamera;
pub use scene_camera::{LabelledCamera, SceneCamera};
pub use world::{CameraWorld, ReferenceWorld};

//! The two worlds that frames are rendered in: the reference camera's, and the second one of evaluation.
//!
//! Each has a rig of its own; layouts are rendered through the same camera as the frames.

use ds_camera::{Appearance, Condition, PixelClass, ReferenceCamera};
use ds_raster::RgbImage;
use ds_second_camera::AbroadCamera;
use ds_space::{CameraModel, Pose, Rig, World};
use ds_world::{Scene, WorldState};

use crate::recipe::Source;

/// A camera of either world, prepared for a scene and a look.
pub enum Eye {
    /// World A.
    Reference(Box<ReferenceCamera>),
    /// World B.
    Abroad(Box<AbroadCamera>),
}

impl Eye {
    /// Prepares a scene.
    #[must_use]
    pub fn new(source: Source, scene: &Scene, appearance: Appearance) -> Self {
        match source {
            // Photographs are not rendered; asked all the same, the reference camera shows the drive.
            Source::Reference | Source::Imported | Source::Nuscenes | Source::Openscene => {
                Self::Reference(Box::new(ReferenceCamera::new(scene, appearance)))
            }
            Source::Abroad => {
                let condition = appearance.condition.unwrap_or(Condition::DAY);
                Self::Abroad(Box::new(AbroadCamera::new(scene, condition, appearance.palette_seed)))
            }
        }
    }

    /// Returns the camera of the world's rig for a scenario's camera, at a size in pixels.
    #[must_use]
    pub fn rig(source: Source, camera: &CameraModel, (width_px, height_px): (u32, u32)) -> CameraModel {
        let resized = CameraModel { intrinsics: camera.intrinsics.resized(width_px, height_px), ..camera.clone() };
        if source == Source::Abroad { AbroadCamera::rig(&resized) } else { resized }
    }

    /// Renders a picture.
    #[must_use]
    pub fn render(&self, world: &WorldState, camera: &CameraModel, world_from_rig: Pose<World, Rig>) -> RgbImage {
        match self {
            Self::Reference(eye) => eye.render(world, camera, world_from_rig),
            Self::Abroad(eye) => eye.render(world, camera, world_from_rig),
        }
    }

    /// Returns what each pixel belongs to, rows top to bottom.
    #[must_use]
    pub fn classes(
        &self,
        world: &WorldState,
        camera: &CameraModel,
        world_from_rig: Pose<World, Rig>,
    ) -> Vec<PixelClass> {
        match self {
            Self::Reference(eye) => eye.classes(world, camera, world_from_rig),
            Self::Abroad(eye) => eye.classes(world, camera, world_from_rig),
        }
    }
}

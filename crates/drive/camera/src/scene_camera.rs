//! What a camera of a prepared scene does: render what is seen from a rig, and say what each pixel of that belongs to.

use ds_raster::{ImageError, PixelClass, RgbImage};
use ds_space::{CameraModel, Pose, Rig, World};
use ds_world::WorldState;

/// A prepared scene.
pub trait SceneCamera {
    /// Renders what a camera on a rig that stands at a place sees.
    ///
    /// # Errors
    /// If the size of the camera is more than can be rendered.
    fn render(
        &self,
        world: &WorldState,
        model: &CameraModel,
        world_from_rig: Pose<World, Rig>,
    ) -> Result<RgbImage, ImageError>;

    /// Renders what a camera on the ego sees.
    ///
    /// # Errors
    /// As [`Self::render`].
    fn on_ego(&self, world: &WorldState, model: &CameraModel) -> Result<RgbImage, ImageError> {
        self.render(world, model, world.ego.pose.world_from_rig(0.0))
    }
}

/// A prepared scene whose pictures come with their truth.
pub trait LabelledCamera: SceneCamera {
    /// Returns what each pixel belongs to, rows top to bottom.
    ///
    /// # Errors
    /// As [`SceneCamera::render`].
    fn classes(
        &self,
        world: &WorldState,
        model: &CameraModel,
        world_from_rig: Pose<World, Rig>,
    ) -> Result<Vec<PixelClass>, ImageError>;
}

//! A camera world: what turns a scene and a look into frames with their truth.
//!
//! World A is the reference camera, on whose frames everything is trained. A world of other assets, light and lens
//! implements the same two traits and is looked at in evaluations only.

use ds_raster::{ImageError, PixelClass, RgbImage};
use ds_space::{CameraModel, Pose, Rig, World};
use ds_world::{Scene, WorldState};

use crate::{Appearance, ReferenceCamera};

/// A way to see scenes.
pub trait CameraWorld: Sync {
    /// Returns the name in tables.
    fn name(&self) -> &'static str;

    /// Returns the camera of this world's rig in the place of a scenario's own.
    fn rig(&self, model: &CameraModel) -> CameraModel {
        model.clone()
    }

    /// Returns a scenario on roads of this world's own, drawn from a seed, if it has such.
    fn own_scenario(&self, _seed: u64) -> Option<Scene> {
        None
    }

    /// Prepares a scene in a look.
    fn camera(&self, scene: &Scene, look: &Appearance) -> Box<dyn SceneCamera>;
}

/// A prepared scene.
pub trait SceneCamera {
    /// Renders what a camera on a rig sees.
    ///
    /// # Errors
    /// If the size of the camera is more than can be rendered.
    fn render(
        &self,
        world: &WorldState,
        model: &CameraModel,
        world_from_rig: Pose<World, Rig>,
    ) -> Result<RgbImage, ImageError>;

    /// Returns what each pixel belongs to, rows top to bottom.
    ///
    /// # Errors
    /// As [`Self::render`].
    fn classes(
        &self,
        world: &WorldState,
        model: &CameraModel,
        world_from_rig: Pose<World, Rig>,
    ) -> Result<Vec<PixelClass>, ImageError>;
}

/// World A, seen by the reference camera.
#[derive(Debug, Clone, Copy, Default)]
pub struct ReferenceWorld;

impl CameraWorld for ReferenceWorld {
    fn name(&self) -> &'static str {
        "A"
    }

    fn camera(&self, scene: &Scene, look: &Appearance) -> Box<dyn SceneCamera> {
        Box::new(ReferenceCamera::new(scene, *look))
    }
}

impl SceneCamera for ReferenceCamera {
    fn render(
        &self,
        world: &WorldState,
        model: &CameraModel,
        world_from_rig: Pose<World, Rig>,
    ) -> Result<RgbImage, ImageError> {
        Self::render(self, world, model, world_from_rig)
    }

    fn classes(
        &self,
        world: &WorldState,
        model: &CameraModel,
        world_from_rig: Pose<World, Rig>,
    ) -> Result<Vec<PixelClass>, ImageError> {
        Self::classes(self, world, model, world_from_rig)
    }
}

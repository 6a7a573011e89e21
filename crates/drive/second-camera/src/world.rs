//! World B as [`CameraWorld`]: roads, rig and camera of its own.

use ds_camera::{Appearance, CameraWorld, SceneCamera};
use ds_raster::{ImageError, PixelClass, RgbImage};
use ds_space::{CameraModel, Pose, Rig, World};
use ds_world::{Scene, WorldState};

use crate::{SecondCamera, roads};

/// World B, seen by the second camera.
#[derive(Debug, Clone, Copy, Default)]
pub struct SecondWorld;

impl CameraWorld for SecondWorld {
    fn name(&self) -> &'static str {
        "B"
    }

    fn rig(&self, model: &CameraModel) -> CameraModel {
        SecondCamera::rig(model)
    }

    fn own_scenario(&self, seed: u64) -> Option<Scene> {
        Some(roads::scene(seed))
    }

    fn camera(&self, scene: &Scene, look: &Appearance) -> Box<dyn SceneCamera> {
        Box::new(SecondCamera::new(scene, look))
    }
}

impl SceneCamera for SecondCamera {
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

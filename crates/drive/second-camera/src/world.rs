//! World B as [`CameraWorld`]: roads, rig and camera of its own.

use ds_camera::{Appearance, CameraWorld, LabelledCamera};
use ds_space::CameraModel;
use ds_world::Scene;

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

    fn camera(&self, scene: &Scene, look: &Appearance) -> Box<dyn LabelledCamera> {
        Box::new(SecondCamera::new(scene, look))
    }
}

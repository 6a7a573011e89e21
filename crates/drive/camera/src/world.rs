//! A camera world: what turns a scene and a look into frames with their truth.
//!
//! World A is the reference camera, on whose frames everything is trained. A world of other assets, light and lens
//! implements [`CameraWorld`] too and is looked at in evaluations only.

use ds_space::CameraModel;
use ds_world::Scene;

use crate::scene_camera::LabelledCamera;
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
    fn camera(&self, scene: &Scene, look: &Appearance) -> Box<dyn LabelledCamera>;
}

/// World A, seen by the reference camera.
#[derive(Debug, Clone, Copy, Default)]
pub struct ReferenceWorld;

impl CameraWorld for ReferenceWorld {
    fn name(&self) -> &'static str {
        "A"
    }

    fn camera(&self, scene: &Scene, look: &Appearance) -> Box<dyn LabelledCamera> {
        Box::new(ReferenceCamera::new(scene, *look))
    }
}

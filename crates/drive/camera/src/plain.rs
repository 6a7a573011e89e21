//! The plain camera: the flat look of a simple game engine, from the same geometry without surroundings, textures,
//! shadows and weather. Stands for `sim-rgb` where observation sources are compared.

use ds_raster::{ImageError, RgbImage, View};
use ds_space::{CameraModel, Pose, Rig, Vec3, World};
use ds_world::{Scene, WorldState};

use crate::geometry::Geometry;
use crate::reference::surfaces;
use crate::scene_camera::SceneCamera;
use crate::surface::{Material, Rgb, Surface};

/// Renders a scene with one flat colour per face.
#[derive(Debug, Clone)]
pub struct PlainCamera {
    geometry: Geometry,
}

impl PlainCamera {
    /// Prepares a scene.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        Self { geometry: Geometry::new(scene, 0, Vec::new()) }
    }
}

impl SceneCamera for PlainCamera {
    fn render(
        &self,
        world: &WorldState,
        camera: &CameraModel,
        world_from_rig: Pose<World, Rig>,
    ) -> Result<RgbImage, ImageError> {
        let (lens, view) = View::through(&camera.intrinsics, world_from_rig * camera.rig_from_camera);
        let raster = surfaces(&self.geometry, world, &view, false)?;
        let colours = lens.develop(raster.values().iter().map(flat).collect());
        RgbImage::new(camera.intrinsics.width_px, camera.intrinsics.height_px, colours.into_flattened())
    }
}

/// Returns a surface's colour, shaded by its facing alone.
fn flat(surface: &Surface) -> Rgb {
    match surface.material {
        Material::Sky => [150, 190, 230],
        Material::Lamp => surface.colour,
        material if material.is_ground() => surface.colour,
        _ => {
            let normal = Vec3::from_array(surface.normal.map(f32::from)) / 127.0;
            let shade = 0.72 + 0.28 * normal.dot(Vec3::new(0.35, 0.25, 0.9)).clamp(-1.0, 1.0);
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "float casts saturate")]
            let shaded = surface.colour.map(|c| (f32::from(c) * shade) as u8);
            shaded
        }
    }
}

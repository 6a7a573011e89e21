//! The geometry of a layout picture: its depth by the software rasteriser, whichever back end draws the colours, and the boxes
//! that move.

use std::sync::Arc;

use ds_raster::geometry::INVERSE_DEPTH_STEP;
use ds_raster::{DepthRaster, Geometry, Lens, Mover, RgbImage, View};

use crate::colour;
use crate::error::LayoutError;
use crate::scene::{LayoutScene, Shot};

/// Returns the geometry of a shot: of what stands on the plane of the ground and of the ground; infinitely far is the sky.
pub(crate) fn of(shot: &Shot, lens: &Lens) -> Result<Geometry, LayoutError> {
    let world_from_camera = shot.world_from_rig * shot.camera.rig_from_camera;
    let view = View::new(lens.pinhole(), world_from_camera);
    let width = lens.pinhole().width_px;
    let mut raster = DepthRaster::new(width, lens.pinhole().height_px, ())?;
    for (corners, _) in shot.scene.solids(&view) {
        view.fill(&mut raster, &corners, ());
    }
    let (height_m, width) = (view.origin().z, width as usize);
    let depths = raster.inverse_depths().iter().enumerate().map(|(index, standing)| {
        let ray = view.ray((index % width) as f64 + 0.5, (index / width) as f64 + 0.5);
        let ground = if height_m > 0.0 { -ray.z / height_m } else { 0.0 };
        let steps = ground.max(f64::from(*standing)) / INVERSE_DEPTH_STEP;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "float casts saturate")]
        let steps = steps.round() as u16;
        steps
    });
    Ok(Geometry {
        lens: shot.camera.intrinsics,
        world_from_camera,
        inverse_depths: lens.develop(depths.collect()).into(),
        movers: movers(&shot.scene),
    })
}

/// Returns the geometry that a frame is carried along by: infinitely far, as the sky, is also what its picture tells exactly, and the
/// pixels beside it, which would be painted twice.
#[must_use]
pub fn carriable(mut geometry: Geometry, picture: &RgbImage) -> Geometry {
    let inverse_depths = Arc::make_mut(&mut geometry.inverse_depths);
    for at in told(picture) {
        inverse_depths[at] = 0;
    }
    geometry
}

/// Returns the pixels of what a picture tells exactly and their neighbours.
fn told(picture: &RgbImage) -> impl Iterator<Item = usize> {
    let [width, height] = [picture.width_px(), picture.height_px()].map(|side| side as usize);
    let pixels = picture.rgb().chunks_exact(3).enumerate();
    let told = pixels.filter(|(_, rgb)| colour::is_told([rgb[0], rgb[1], rgb[2]]));
    told.flat_map(move |(at, _)| {
        let (x, y) = (at % width, at / width);
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        rows.flat_map(move |row| (x.saturating_sub(1)..(x + 2).min(width)).map(move |column| row * width + column))
    })
}

fn movers(scene: &LayoutScene) -> Vec<Mover> {
    let mover = |agent: &ds_world::AgentState| Mover {
        id: agent.id.0,
        pose: agent.pose,
        bottom_m: agent.z_m,
        size_m: [agent.size.length_m, agent.size.width_m, agent.size.height_m],
    };
    scene.world.agents.iter().map(mover).collect()
}

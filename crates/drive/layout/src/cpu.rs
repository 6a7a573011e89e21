//! The `cpu` back end: a scene through the software rasteriser; no driver needed, bit-reproducible.

use ds_raster::{DepthRaster, View};
use ds_space::DVec3;

use crate::colour::{GROUND, Rgb, SKY};
use crate::error::LayoutError;
use crate::scene::LayoutScene;

/// Renders the pinhole picture of a scene.
pub(crate) fn render(scene: &LayoutScene, view: &View) -> Result<Vec<Rgb>, LayoutError> {
    let (width_px, height_px) = (view.pinhole().width_px, view.pinhole().height_px);
    let mut raster = DepthRaster::new(width_px, height_px, SKY)?;
    raster.clear_with(|x, y| background(view, x, y));
    for piece in scene.map.pieces.iter().filter(|piece| piece.may_be_seen(view)) {
        for triangle in &piece.triangles {
            view.paint(&mut raster, &triangle.map(|corner| corner.extend(0.0)), piece.colour);
        }
    }
    for (corners, colour) in scene.ground(view) {
        view.paint(&mut raster, &corners, colour);
    }
    for (corners, colour) in scene.solids(view) {
        view.fill(&mut raster, &corners, colour);
    }
    Ok(raster.values().to_vec())
}

/// Returns ground below the horizon and sky above it.
fn background(view: &View, x: usize, y: usize) -> Rgb {
    let ray: DVec3 = view.ray(x as f64 + 0.5, y as f64 + 0.5);
    if ray.z < 0.0 { GROUND } else { SKY }
}

//! Shadows of the sun by a depth map seen from it: one orthographic picture of what stands around the camera.
//!
//! The raster keeps the greatest "inverse depth"; here that is how far a point lies towards the sun, shifted to be
//! positive.

use ds_raster::{DepthRaster, ScreenPoint};
use ds_space::DVec3;

use crate::mesh::Face;

const SIDE: u32 = 448;
const REACH_M: f64 = 64.0;

/// What the sun sees around a place.
pub(crate) struct ShadowMap {
    raster: DepthRaster<u8>,
    centre: DVec3,
    right: DVec3,
    up: DVec3,
    towards: DVec3,
}

impl ShadowMap {
    /// Prepares an empty map around a place for a direction towards the sun.
    pub(crate) fn new(centre: DVec3, towards: DVec3) -> Option<Self> {
        let right = DVec3::new(-towards.y, towards.x, 0.0).try_normalize()?;
        let up = towards.cross(right);
        Some(Self { raster: DepthRaster::new(SIDE, SIDE, 0).ok()?, centre, right, up, towards })
    }

    fn on_map(&self, point: DVec3) -> ScreenPoint {
        let local = point - self.centre;
        let pixel = |along: f64| (along / REACH_M + 1.0) * 0.5 * f64::from(SIDE);
        ScreenPoint {
            x_px: pixel(local.dot(self.right)),
            y_px: pixel(local.dot(self.up)),
            inverse_depth: 1_000.0 + local.dot(self.towards),
        }
    }

    /// Adds faces.
    pub(crate) fn add(&mut self, faces: &[Face]) {
        for (corners, _) in faces {
            let corners = corners.map(|corner| self.on_map(corner));
            self.raster.fill(&corners, 1);
        }
    }

    /// Returns how much of the sun is hidden from a place, 0 to 1, over four neighbouring samples.
    pub(crate) fn hidden(&self, place: DVec3) -> f32 {
        let at = self.on_map(place);
        let mut hidden = 0.0;
        for (dx, dy) in [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)] {
            let (x, y) = (at.x_px + dx, at.y_px + dy);
            if x < 0.0 || y < 0.0 || x >= f64::from(SIDE) || y >= f64::from(SIDE) {
                continue;
            }
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "inside the map")]
            let index = y as usize * SIDE as usize + x as usize;
            if f64::from(self.raster.inverse_depths()[index]) > at.inverse_depth + 0.35 {
                hidden += 0.25;
            }
        }
        hidden
    }
}

//! Effects of camera and video model on finished frames, one frame at a time: no memory, so that any worker can go on.
//!
//! Depth is that of a flat road under the camera, at most 150 m; motion is known where the frame is made of the world.

use std::sync::Arc;

use ds_effect::frame::{FrameChain, FrameContext, Pinhole};
use ds_effect::picture::Picture;
use ds_effect::{FrameEffect, frame_library};
use ds_process::maker::{Fault, bad};
use ds_raster::RgbImage;
use ds_space::{CameraModel, DVec3, Tick};
use ds_topic::SceneMessage;

const FARTHEST_M: f64 = 150.0;

/// What alters the frames of an episode.
pub struct Lens {
    scene: Arc<SceneMessage>,
    effects: Vec<(&'static FrameEffect, Vec<f64>)>,
    /// Depth along the axis of each camera, one value per pixel.
    depth_m: Vec<Vec<f32>>,
}

/// Forward speed and yaw rate, m/s and rad/s.
pub type Motion = (f64, f64);

impl Lens {
    /// Takes the effects of an episode that act on frames; `None` if it has none.
    #[must_use]
    pub fn of(scene: &Arc<SceneMessage>) -> Option<Self> {
        let known = |id: &str| frame_library().iter().copied().find(|effect| effect.id == id);
        // What the car's own library knows, such as `obs_latency`, is done elsewhere.
        let here = scene.spec.effects.iter().filter(|effect| !ds_effect::acts_on_the_world(&effect.id));
        let effects: Vec<_> = here.filter_map(|effect| Some((known(&effect.id)?, effect.values.clone()))).collect();
        if effects.is_empty() {
            return None;
        }
        let depth_m = scene.scene.cameras.iter().map(ground_depth).collect();
        Some(Self { scene: Arc::clone(scene), effects, depth_m })
    }

    /// Returns a frame as the altered camera or model would have made it.
    ///
    /// # Errors
    /// If the result is no image.
    pub fn see(&self, image: &RgbImage, tick: Tick, camera: u16, motion: Option<Motion>) -> Result<RgbImage, Fault> {
        let (width, height) = (image.width_px() as usize, image.height_px() as usize);
        let lens = &self.scene.scene.cameras[usize::from(camera)].intrinsics;
        let source = Picture { width, height, channels: 3, data: image.rgb().iter().map(|v| f32::from(*v)).collect() };
        let context = FrameContext {
            frame: u64::from(tick.0),
            time_secs: f64::from(tick.0) * self.scene.scene.dt.secs(),
            frames_since_anchor: f64::from(tick.0),
            speed_mps: motion.map(|motion| motion.0),
            yaw_rate_radps: motion.map(|motion| motion.1),
            light: 1.0,
            depth_m: Some(&self.depth_m[usize::from(camera)]),
            boxes: &[],
            camera: Pinhole { fx: lens.fx_px, fy: lens.fy_px, cx: lens.cx_px - 0.5, cy: lens.cy_px - 0.5 },
            size: [width, height],
            sensor_rows: height as f64,
            seed: self.scene.spec.seed,
        };
        let seen = FrameChain::new(&self.effects).next(&source, &context);
        let rgb = seen.data.iter().map(|v| v.round().clamp(0.0, 255.0) as u8).collect();
        RgbImage::new(image.width_px(), image.height_px(), rgb).map_err(|error| bad("effect_failed", &error))
    }
}

/// Returns the depth of a flat road along a camera's axis, row by row.
fn ground_depth(camera: &CameraModel) -> Vec<f32> {
    let lens = &camera.intrinsics;
    let origin = camera.rig_from_camera * DVec3::ZERO;
    let mut depth = Vec::with_capacity((lens.width_px * lens.height_px) as usize);
    for row in 0..lens.height_px {
        for column in 0..lens.width_px {
            let ray = DVec3::new(
                (f64::from(column) + 0.5 - lens.cx_px) / lens.fx_px,
                (f64::from(row) + 0.5 - lens.cy_px) / lens.fy_px,
                1.0,
            );
            // One metre along the axis lowers the ray by this much.
            let drop_m = origin.z - (camera.rig_from_camera * ray).z;
            let metres = if drop_m > 1e-6 { (origin.z / drop_m).min(FARTHEST_M) } else { FARTHEST_M };
            depth.push(metres as f32);
        }
    }
    depth
}

//! A picture of the log of half a second ago or more, warped into the present view: what a reconstruction without a model
//! shows.
//!
//! The reference camera's picture of the log at the last tick up to t − 5 at which the log's ego was not ahead of where the ego
//! stands now (from ahead the road between both is not seen) is splatted by its true depth to that place; what belongs to a vehicle or person moves with it, and is left out where it is gone. Of
//! the samples that fall on a pixel the nearest count; pixels that none falls on are filled from their neighbours.

use std::sync::Arc;

use ds_raster::view::NEAR_M;
use ds_raster::{ImageError, PixelClass, RgbImage, View};
use ds_space::{CameraModel, DVec3, Pose, Rig, Tick, World};
use ds_world::{AgentState, Scene, WorldState};

use crate::appearance::Appearance;
use crate::reference::{ReferenceCamera, Sampling, surfaces};
use crate::scene_camera::SceneCamera;
use crate::surface::Surface;

/// How much older the log's picture is at least, in ticks.
const AGE_TICKS: u32 = 5;
/// Depth of the sky, in metres.
const SKY_M: f64 = 5_000.0;
/// Samples per pixel and side.
const DENSITY: u32 = 2;
/// How far beyond its box a body may reach, in metres.
const BODY_MARGIN_M: f64 = 0.4;
/// Samples of a pixel count up to this much more than the least depth, as a share.
const DEPTH_SHARE: f64 = 0.03;

/// Renders the log's pictures from where the ego is.
#[derive(Debug, Clone)]
pub struct ReprojectedCamera {
    scene: Arc<Scene>,
    camera: ReferenceCamera,
}

/// A sample in the present view.
struct Sample {
    pixel: usize,
    depth_m: f64,
    colour: [u8; 3],
}

impl ReprojectedCamera {
    /// Prepares a scene with its log.
    #[must_use]
    pub fn new(scene: Arc<Scene>, appearance: Appearance) -> Self {
        let camera = ReferenceCamera::new(&scene, appearance).with_sampling(Sampling::Single);
        Self { scene, camera }
    }

    /// Returns the world of the log whose picture is taken.
    fn past(&self, world: &WorldState) -> WorldState {
        let ahead = |tick: &u32| world.ego.pose.to_local(self.scene.logged_ego(Tick(*tick)).pose.position).x > 0.0;
        let latest = world.tick.0.saturating_sub(AGE_TICKS);
        self.scene.logged_world(Tick((0..=latest).rev().find(|tick| !ahead(tick)).unwrap_or(0)))
    }

    /// Takes every sample of the log's picture to the present view.
    fn samples(&self, world: &WorldState, camera: &CameraModel, view: &View) -> Result<Vec<Sample>, ImageError> {
        let past = self.past(world);
        let size = view.pinhole();
        let fine = size.resized(DENSITY * size.width_px, DENSITY * size.height_px);
        let model = CameraModel { intrinsics: fine, ..camera.clone() };
        let rig = past.ego.pose.world_from_rig(0.0);
        let picture = self.camera.on_ego(&past, &model)?;
        let from = View::new(&fine, rig * camera.rig_from_camera);
        let raster = surfaces(self.camera.geometry(), &past, &from, false)?;
        let mut samples = Vec::with_capacity(raster.values().len());
        for (at, (surface, inverse)) in raster.values().iter().zip(raster.inverse_depths()).enumerate() {
            let (x, y) = (at % raster.width(), at / raster.width());
            let ray = from.ray(x as f64 + 0.5, y as f64 + 0.5);
            let point = from.origin() + ray * depth(surface, *inverse, &ray, &from.origin());
            let Some(point) = carried(surface, point, &past, world) else { continue };
            let seen = view.to_camera(point);
            if seen.z < NEAR_M {
                continue;
            }
            let column = (size.cx_px + size.fx_px * seen.x / seen.z).floor();
            let row = (size.cy_px + size.fy_px * seen.y / seen.z).floor();
            if column < 0.0 || row < 0.0 || column >= f64::from(size.width_px) || row >= f64::from(size.height_px) {
                continue;
            }
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the picture")]
            let pixel = row as usize * size.width_px as usize + column as usize;
            samples.push(Sample { pixel, depth_m: seen.z, colour: picture.pixel(x as u32, y as u32) });
        }
        Ok(samples)
    }
}

impl SceneCamera for ReprojectedCamera {
    fn render(
        &self,
        world: &WorldState,
        camera: &CameraModel,
        world_from_rig: Pose<World, Rig>,
    ) -> Result<RgbImage, ImageError> {
        let (lens, view) = View::through(&camera.intrinsics, world_from_rig * camera.rig_from_camera);
        let samples = self.samples(world, camera, &view)?;
        let colours = lens.develop(filled(view.pinhole().width_px as usize, mixed(&view, &samples)));
        RgbImage::new(camera.intrinsics.width_px, camera.intrinsics.height_px, colours.into_flattened())
    }
}

/// Returns the depth of a sample: that of the ground plane, of what was drawn, or of the sky.
fn depth(surface: &Surface, inverse: f32, ray: &DVec3, eye: &DVec3) -> f64 {
    match surface.class {
        PixelClass::Sky => SKY_M,
        _ if surface.material.is_ground() => (eye.z / (-ray.z).max(1e-4)).min(SKY_M),
        _ => (1.0 / f64::from(inverse.max(1e-6))).min(SKY_M),
    }
}

/// Returns where a point of the past world is now; none where it belonged to somebody who is gone.
fn carried(surface: &Surface, point: DVec3, past: &WorldState, now: &WorldState) -> Option<DVec3> {
    if !matches!(surface.class, PixelClass::Vehicle | PixelClass::Person) {
        return Some(point);
    }
    let within = |agent: &&AgentState| {
        let local = agent.pose.to_local(point.truncate());
        local.x.abs() <= 0.5 * agent.size.length_m + BODY_MARGIN_M
            && local.y.abs() <= 0.5 * agent.size.width_m + BODY_MARGIN_M
    };
    let Some(owner) = past.agents.iter().find(within) else { return Some(point) };
    let agent = now.agents.iter().find(|agent| agent.id == owner.id)?;
    let place = agent.pose.to_outer(owner.pose.to_local(point.truncate()));
    Some(place.extend(point.z + agent.z_m - owner.z_m))
}

/// Returns the mean colour of the nearest samples of each pixel; none where there is no sample.
fn mixed(view: &View, samples: &[Sample]) -> Vec<Option<[u8; 3]>> {
    let count = view.pinhole().width_px as usize * view.pinhole().height_px as usize;
    let mut nearest = vec![f64::INFINITY; count];
    for sample in samples {
        nearest[sample.pixel] = nearest[sample.pixel].min(sample.depth_m);
    }
    let mut sums = vec![[0u32; 4]; count];
    for sample in samples.iter().filter(|sample| sample.depth_m <= nearest[sample.pixel] * (1.0 + DEPTH_SHARE)) {
        let [red, green, blue] = sample.colour.map(u32::from);
        let sum = &mut sums[sample.pixel];
        *sum = [sum[0] + red, sum[1] + green, sum[2] + blue, sum[3] + 1];
    }
    sums.iter().map(mean).collect()
}

/// Returns the mean of summed colours; none of nothing.
fn mean([red, green, blue, count]: &[u32; 4]) -> Option<[u8; 3]> {
    #[expect(clippy::cast_possible_truncation, reason = "a mean of bytes is one")]
    let byte = |sum: &u32| ((sum + count / 2) / count) as u8;
    (*count > 0).then(|| [byte(red), byte(green), byte(blue)])
}

/// Fills pixels round by round with the mean of those beside them.
fn filled(width: usize, mut pixels: Vec<Option<[u8; 3]>>) -> Vec<[u8; 3]> {
    let height = pixels.len() / width.max(1);
    while pixels.iter().any(Option::is_none) {
        let before = pixels.clone();
        for (at, pixel) in pixels.iter_mut().enumerate().filter(|(_, pixel)| pixel.is_none()) {
            let (x, y) = (at % width, at / width);
            let mut sum = [0; 4];
            let beside = [
                (x > 0).then(|| at - 1),
                (x + 1 < width).then_some(at + 1),
                (y > 0).then(|| at - width),
                (y + 1 < height).then_some(at + width),
            ];
            for [red, green, blue] in beside.into_iter().flatten().filter_map(|at| before[at]) {
                let more = [red, green, blue].map(u32::from);
                sum = [sum[0] + more[0], sum[1] + more[1], sum[2] + more[2], sum[3] + 1];
            }
            *pixel = mean(&sum);
        }
        if pixels == before {
            // Nothing was seen at all.
            return vec![[0; 3]; pixels.len()];
        }
    }
    pixels.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holes_are_filled_from_their_neighbours() {
        let (a, b) = (Some([10; 3]), Some([20; 3]));
        assert_eq!(filled(3, vec![a, None, b]), [[10; 3], [15; 3], [20; 3]]);
        assert_eq!(filled(2, vec![a, None, None, None]), [[10; 3]; 4]);
        assert_eq!(filled(2, vec![None; 2]), [[0; 3]; 2]);
    }
}

//! Traffic lights: where a frame shows one, and which state it shows there.
//!
//! The place is known from the map: a head that faces the camera and lies wholly in the picture. A small network looks at
//! a square around it, sampled to 16×16 pixels whatever the distance, and says red, yellow or green.

use ds_graph::classifier::{Classifier, ClassifierShape};
use ds_nn::{Array, Weights, WeightsError};
use ds_space::{CameraModel, DVec2, Pose, Rig, World};
use ds_world::{LightState, TrafficLight, WorldState};

use crate::label::Label;
use crate::reader::{Reader, Task};

/// Side of what the network sees, in pixels.
pub const CROP_PX: usize = 16;
/// Height of a head, in metres.
pub const HEAD_M: f64 = 1.1;
/// Side of the square that is looked at, in metres.
const AROUND_M: f64 = 1.8;
/// Heads that are turned further away than this are not looked at, in radians.
const FACING_RAD: f64 = 1.0;
/// Heads are looked at up to this far, in metres.
const RANGE_M: f64 = 90.0;

/// The states that the network tells apart, in the order of its scores.
pub const STATES: [LightState; 3] = [LightState::Red, LightState::Yellow, LightState::Green];

/// The network's sizes: four bands of the last level, so that the place of the lit lamp counts.
pub const SHAPE: ClassifierShape = ClassifierShape { widths: &[16, 24], bands: 4, features: 32, scores: STATES.len() };

/// A head that a frame shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenLight {
    /// Centre in the picture, in pixels.
    pub centre_px: DVec2,
    /// Pixels per metre there.
    pub scale_px: f64,
    /// Distance from the camera, in metres.
    pub distance_m: f64,
    /// What it shows.
    pub state: LightState,
}

impl SeenLight {
    /// Returns the height of the head in the picture, in pixels.
    #[must_use]
    pub fn height_px(&self) -> f64 {
        HEAD_M * self.scale_px
    }
}

/// Returns the distance beyond which a head is lower than two pixels, in metres.
#[must_use]
pub fn two_pixel_distance_m(model: &CameraModel) -> f64 {
    model.intrinsics.fy_px * HEAD_M / 2.0
}

/// Lists the heads that a frame shows: red, yellow or green, facing the camera, in the picture and not behind a road
/// user (`labels` are the frame's own).
#[must_use]
pub fn seen(
    heads: &[TrafficLight],
    world: &WorldState,
    labels: &[Label],
    model: &CameraModel,
    world_from_rig: Pose<World, Rig>,
) -> Vec<SeenLight> {
    let world_from_camera = world_from_rig * model.rig_from_camera;
    let camera_from_world = world_from_camera.inverse();
    let size = &model.intrinsics;
    let look = |(index, head): (usize, &TrafficLight)| {
        let state = world.lights.get(index).copied().filter(|state| STATES.contains(state))?;
        let back = (world_from_camera.translation - head.position).truncate();
        let turned = DVec2::from_angle(head.facing_rad).angle_to(back).abs();
        let inside = camera_from_world * head.position;
        let centre_px = size.project(inside)?;
        let (distance_m, scale_px) = (inside.length(), size.fy_px / inside.z);
        let reach = 0.5 * AROUND_M * scale_px;
        let whole = centre_px.x >= reach
            && centre_px.y >= reach
            && centre_px.x + reach <= f64::from(size.width_px)
            && centre_px.y + reach <= f64::from(size.height_px);
        if !whole || turned > FACING_RAD || distance_m > RANGE_M {
            return None;
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "it was found to lie inside")]
        let at = centre_px.y as usize * size.width_px as usize + centre_px.x as usize;
        let hidden = labels.get(at).is_some_and(|label| matches!(label, Label::Vehicle | Label::Pedestrian));
        (!hidden).then_some(SeenLight { centre_px, scale_px, distance_m, state })
    };
    heads.iter().enumerate().filter_map(look).collect()
}

/// Samples the square around a head from a frame's values [H, W, 3]: [16, 16, 3], smooth between pixels.
#[must_use]
pub fn crop(values: &[f32], width_px: usize, light: &SeenLight) -> Vec<f32> {
    let height_px = values.len() / 3 / width_px;
    let step = AROUND_M * light.scale_px / CROP_PX as f64;
    let mut out = Vec::with_capacity(CROP_PX * CROP_PX * 3);
    for row in 0..CROP_PX {
        for column in 0..CROP_PX {
            let place = |index: usize, centre: f64, count: usize| {
                let at = centre + (index as f64 + 0.5 - 0.5 * CROP_PX as f64) * step - 0.5;
                let at = at.clamp(0.0, count as f64 - 1.0);
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped just before")]
                let low = (at as usize).min(count.saturating_sub(2));
                #[expect(clippy::cast_possible_truncation, reason = "pixels are single precision")]
                let share = (at - low as f64) as f32;
                (low, share)
            };
            let (x, right) = place(column, light.centre_px.x, width_px);
            let (y, down) = place(row, light.centre_px.y, height_px);
            for colour in 0..3 {
                let pixel = |y: usize, x: usize| values[(y * width_px + x) * 3 + colour];
                let upper = pixel(y, x) + right * (pixel(y, x + 1) - pixel(y, x));
                let lower = pixel(y + 1, x) + right * (pixel(y + 1, x + 1) - pixel(y + 1, x));
                out.push(upper + down * (lower - upper));
            }
        }
    }
    out
}

/// Telling which state a crop shows.
pub struct LightStates;

impl Task for LightStates {
    type Network = Classifier;

    fn bind(weights: &Weights) -> Result<Self::Network, WeightsError> {
        Classifier::new(SHAPE, weights)
    }
}

/// The network, ready to read lights.
pub type LightReader = Reader<LightStates>;

impl LightReader {
    /// Says which state each crop shows.
    #[must_use]
    pub fn read(&self, crops: &[Vec<f32>]) -> Vec<LightState> {
        if crops.is_empty() {
            return Vec::new();
        }
        let images = Array::new(&[crops.len(), CROP_PX, CROP_PX, 3], crops.concat());
        let scores = self.network.answer(&images).scores;
        scores.values().chunks_exact(STATES.len()).map(|scores| STATES[crate::segmenter::highest(scores)]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_space::{CameraId, DVec3, Intrinsics, PoseSe2};

    fn model() -> CameraModel {
        let id = CameraId::new("front").expect("a plain word is an id");
        CameraModel::mounted(id, Intrinsics::centred(160, 96, 1.2), DVec3::new(1.5, 0.0, 1.6), 0.0, 0.0)
    }

    fn light(x: f64, y: f64, facing_rad: f64) -> TrafficLight {
        TrafficLight { position: DVec3::new(x, y, 4.0), facing_rad, lanes: Vec::new(), states: Vec::new() }
    }

    #[test]
    fn heads_are_seen_from_the_front_and_in_the_picture() {
        let half = std::f64::consts::PI;
        let heads = [light(31.5, 0.0, half), light(31.5, 0.0, 0.0), light(31.5, 40.0, half), light(-30.0, 0.0, 0.0)];
        let scene = ds_scenario::generate(ds_scenario::Family::FreeCurve, 1);
        let mut world = scene.logged_world(ds_space::Tick(0));
        world.lights = vec![LightState::Red, LightState::Green, LightState::Red, LightState::Red];
        let rig = PoseSe2::new(0.0, 0.0, 0.0).world_from_rig(0.0);
        let labels = vec![Label::Other; 160 * 96];
        let found = seen(&heads, &world, &labels, &model(), rig);
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(found[0].state, LightState::Red);
        // 116.9 px of focal length over 30 m, 2.4 m above the axis.
        assert!((found[0].scale_px - 116.93 / 30.0).abs() < 0.01, "{found:?}");
        assert!((found[0].centre_px - DVec2::new(80.0, 48.0 - 2.4 * 116.93 / 30.0)).length() < 0.01, "{found:?}");
        assert!((two_pixel_distance_m(&model()) - 64.3).abs() < 0.1);
        world.lights[0] = LightState::Unknown;
        assert!(seen(&heads, &world, &labels, &model(), rig).is_empty(), "nothing is to be read of an unknown light");
        world.lights[0] = LightState::Red;
        assert!(seen(&heads, &world, &[Label::Vehicle; 160 * 96], &model(), rig).is_empty(), "it is hidden");
    }

    #[test]
    fn a_crop_is_centred_on_the_head_and_smooth() {
        let mut values = vec![0.0; 64 * 32 * 3];
        for y in 0..32 {
            for x in 0..64 {
                values[(y * 64 + x) * 3] = x as f32;
                values[(y * 64 + x) * 3 + 1] = y as f32;
            }
        }
        let state = LightState::Red;
        let light = SeenLight { centre_px: DVec2::new(20.0, 12.0), scale_px: 4.0, distance_m: 30.0, state };
        let crop = crop(&values, 64, &light);
        let mean = |colour: usize| crop.iter().skip(colour).step_by(3).sum::<f32>() / 256.0;
        // The centre of the picture's pixel 19 is at 19.5.
        assert!((mean(0) - 19.5).abs() < 1e-4 && (mean(1) - 11.5).abs() < 1e-4, "{} {}", mean(0), mean(1));
        let step = crop[3] - crop[0];
        assert!((step - 1.8 * 4.0 / 16.0).abs() < 1e-4, "{step}");
    }
}

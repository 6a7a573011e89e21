//! Brings a frame of any forward camera to the one camera that the network knows.
//!
//! That camera has 160×96 pixels, 70° across, 1.6 m above the road, 1.5 m before the rear axle, 0.05 rad down. Pixels
//! below the horizon are looked up on the flat road, the others at infinity, so that the road keeps its place; things
//! that stand up are distorted where mountings differ. The same camera gives the same pixels back.

use ds_graph::planner::{HEIGHT_PX, WIDTH_PX};
use ds_nn::Array;
use ds_raster::RgbImage;
use ds_space::{CameraModel, DVec3};

use crate::error::PolicyError;
use crate::observation::Observation;

pub use ds_graph::planner::known_camera;

/// What is shown where the source camera does not reach.
const UNSEEN: [f32; 3] = [115.0; 3];
/// The most samples along each axis of a pixel.
const MOST_SAMPLES: u32 = 4;

/// Looks up frames of a source camera; keeps the look-up table of the last one.
#[derive(Debug, Clone, Default)]
pub struct Eye {
    source: Option<CameraModel>,
    /// For each pixel, `samples` source positions (x, y), in pixels; NaN where unseen.
    table: Vec<[f32; 2]>,
    samples: usize,
}

impl Eye {
    /// Returns the newest frame of the forward camera as networks see it: [1, 96, 160, 3].
    ///
    /// # Errors
    /// [`PolicyError::Observation`] if no camera looks ahead.
    ///
    /// # Panics
    /// If the observation was not checked and a camera has no frame.
    pub fn newest(&mut self, observation: &Observation) -> Result<Array, PolicyError> {
        let newest = observation.frames.iter().map(|frames| frames.last().expect("the observation was checked"));
        self.images(observation.cameras.iter().zip(newest))
    }

    /// Returns the forward camera's frame as networks see it: [1, 96, 160, 3].
    ///
    /// # Errors
    /// [`PolicyError::Observation`] if no camera looks ahead.
    pub fn images<'a>(
        &mut self,
        pairs: impl Iterator<Item = (&'a CameraModel, &'a RgbImage)>,
    ) -> Result<Array, PolicyError> {
        let seen = self.ahead(pairs)?;
        let mut pixels = Vec::with_capacity(seen.rgb().len());
        normalise_into(seen.rgb(), &mut pixels);
        Ok(Array::new(&[1, HEIGHT_PX, WIDTH_PX, 3], pixels))
    }

    /// Returns the forward camera's frame as the known camera would have seen it.
    ///
    /// # Errors
    /// [`PolicyError::Observation`] if no camera looks ahead.
    pub fn ahead<'a>(
        &mut self,
        pairs: impl Iterator<Item = (&'a CameraModel, &'a RgbImage)>,
    ) -> Result<RgbImage, PolicyError> {
        let (camera, frame) = forward_frame(pairs)?;
        Ok(self.look(camera, frame))
    }

    /// Returns the frame as the known camera would have seen it.
    pub fn look(&mut self, camera: &CameraModel, frame: &RgbImage) -> RgbImage {
        let intrinsics = camera.intrinsics.resized(frame.width_px(), frame.height_px());
        let source = CameraModel { intrinsics, ..camera.clone() };
        if self.source.as_ref() != Some(&source) {
            self.prepare(source);
        }
        let mut rgb = Vec::with_capacity(WIDTH_PX * HEIGHT_PX * 3);
        for positions in self.table.chunks_exact(self.samples) {
            let mut sum = [0.0f32; 3];
            for position in positions {
                let colour = sample(frame, *position);
                (0..3).for_each(|c| sum[c] += colour[c]);
            }
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a mean of 8-bit values")]
            rgb.extend(sum.map(|value| (value / positions.len() as f32).round() as u8));
        }
        let known = known_camera().intrinsics;
        RgbImage::new(known.width_px, known.height_px, rgb).expect("the table has one entry per sample of each pixel")
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small positive ratio")]
    fn prepare(&mut self, source: CameraModel) {
        let known = known_camera();
        let ratio = (source.intrinsics.fx_px / known.intrinsics.fx_px - 1e-6).ceil().max(1.0) as u32;
        let across = ratio.min(MOST_SAMPLES);
        self.samples = (across * across) as usize;
        self.table.clear();
        for y in 0..known.intrinsics.height_px {
            for x in 0..known.intrinsics.width_px {
                for part in 0..across * across {
                    let within = |part: u32| (f64::from(part) + 0.5) / f64::from(across);
                    let pixel = (f64::from(x) + within(part % across), f64::from(y) + within(part / across));
                    self.table.push(look_up(&known, &source, pixel));
                }
            }
        }
        self.source = Some(source);
    }
}

#[expect(clippy::cast_possible_truncation, reason = "pixel positions need no double precision")]
fn look_up(known: &CameraModel, source: &CameraModel, (x, y): (f64, f64)) -> [f32; 2] {
    let lens = &known.intrinsics;
    let ray_in_camera = DVec3::new((x - lens.cx_px) / lens.fx_px, (y - lens.cy_px) / lens.fy_px, 1.0);
    let ray = known.rig_from_camera.rotation * ray_in_camera;
    let eye = known.rig_from_camera.translation;
    let source_from_rig = source.rig_from_camera.inverse();
    let in_source =
        if ray.z < -1e-3 { source_from_rig * (eye + ray * (eye.z / -ray.z)) } else { source_from_rig.rotation * ray };
    source.intrinsics.project(in_source).map_or([f32::NAN; 2], |pixel| [pixel.x as f32, pixel.y as f32])
}

/// Returns the colour between pixel centres, or grey outside.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounds were checked just before")]
fn sample(frame: &RgbImage, [x, y]: [f32; 2]) -> [f32; 3] {
    let (width, height) = (frame.width_px(), frame.height_px());
    let inside = (0.0..=width as f32).contains(&x) && (0.0..=height as f32).contains(&y);
    if !inside {
        return UNSEEN;
    }
    let place = |at: f32, side: u32| {
        let at = (at - 0.5).clamp(0.0, side as f32 - 1.0);
        let low = at.floor();
        (low as u32, (low as u32 + 1).min(side - 1), at - low)
    };
    let ((x0, x1, u), (y0, y1, v)) = (place(x, width), place(y, height));
    let mix = |a: [u8; 3], b: [u8; 3], share: f32| {
        [0, 1, 2].map(|c| f32::from(a[c]) + share * (f32::from(b[c]) - f32::from(a[c])))
    };
    let top = mix(frame.pixel(x0, y0), frame.pixel(x1, y0), u);
    let bottom = mix(frame.pixel(x0, y1), frame.pixel(x1, y1), u);
    [0, 1, 2].map(|c| top[c] + v * (bottom[c] - top[c]))
}

/// Appends 8-bit values as the network sees them.
pub fn normalise_into(rgb: &[u8], pixels: &mut Vec<f32>) {
    pixels.extend(rgb.iter().map(|value| (f32::from(*value) * (1.0 / 255.0) - 0.45) * 4.0));
}

/// Returns the frame of the camera that looks most nearly ahead.
fn forward_frame<'a>(
    pairs: impl Iterator<Item = (&'a CameraModel, &'a RgbImage)>,
) -> Result<(&'a CameraModel, &'a RgbImage), PolicyError> {
    let ahead = |camera: &CameraModel| (camera.rig_from_camera.rotation * DVec3::Z).x;
    let best = pairs.reduce(|best, next| if ahead(next.0) > ahead(best.0) { next } else { best });
    let (camera, frame) = best.ok_or(PolicyError::Observation { field: "cameras", problem: "is empty".into() })?;
    if ahead(camera) < 0.7 {
        let problem = format!("has no camera that looks ahead; the nearest is {:?}", camera.id.as_str());
        return Err(PolicyError::Observation { field: "cameras", problem });
    }
    Ok((camera, frame))
}

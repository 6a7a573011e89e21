//! Radial distortion by warping a finished pinhole picture: for each pixel of the distorted picture, where to look.
//!
//! r_distorted = r · (1 + k1·r² + k2·r⁴) is inverted per pixel on its rising part; pixels beyond that part show its end.
//! The pinhole keeps the focal length and is as much larger as the distortion needs, up to twice each side.

use ds_space::{DVec2, Intrinsics};

use crate::image::MAX_SIDE_PX;

/// The largest undistorted radius (tangent of the angle off the axis) that is shown.
const MAX_RADIUS: f64 = 4.0;

/// A lens: the pinhole to render with and the warp that makes the picture of it.
#[derive(Debug, Clone)]
pub struct Lens {
    pinhole: Intrinsics,
    /// Index into the pinhole picture for each pixel; `None` if there is no distortion.
    sources: Option<Vec<u32>>,
}

impl Lens {
    /// Prepares the warp of a camera.
    #[must_use]
    pub fn new(intrinsics: &Intrinsics) -> Self {
        if intrinsics.k1 == 0.0 && intrinsics.k2 == 0.0 {
            return Self { pinhole: *intrinsics, sources: None };
        }
        let directions = directions(intrinsics);
        let least = directions.iter().copied().fold(DVec2::ZERO, DVec2::min);
        let greatest = directions.iter().copied().fold(DVec2::ZERO, DVec2::max);
        let pinhole = around(intrinsics, least, greatest);
        let sources = directions.iter().map(|direction| source(&pinhole, *direction)).collect();
        Self { pinhole, sources: Some(sources) }
    }

    /// Returns the pinhole with which the picture is to be rendered.
    #[must_use]
    pub fn pinhole(&self) -> &Intrinsics {
        &self.pinhole
    }

    /// Makes the camera's picture of the pinhole's pixels, nearest pixel.
    #[must_use]
    pub fn develop<P: Copy>(&self, pixels: Vec<P>) -> Vec<P> {
        match &self.sources {
            None => pixels,
            Some(sources) => sources.iter().map(|source| pixels[*source as usize]).collect(),
        }
    }
}

/// Returns the direction (x/z, y/z) in which each pixel's centre looks, rows top to bottom.
pub(crate) fn directions(camera: &Intrinsics) -> Vec<DVec2> {
    let (straight, limit) = (camera.k1 == 0.0 && camera.k2 == 0.0, rising_limit(camera.k1, camera.k2));
    let across = |x: u32| (f64::from(x) + 0.5 - camera.cx_px) / camera.fx_px;
    let rows = (0..camera.height_px).map(|y| (f64::from(y) + 0.5 - camera.cy_px) / camera.fy_px);
    let seen = rows.flat_map(|down| (0..camera.width_px).map(move |x| DVec2::new(across(x), down)));
    seen.map(|at| if straight { at } else { undistort(at, camera.k1, camera.k2, limit) }).collect()
}

/// Returns the radius up to which the distorted radius rises.
fn rising_limit(k1: f64, k2: f64) -> f64 {
    let slope = |r: f64| 1.0 + r * r * (3.0 * k1 + 5.0 * k2 * r * r);
    let mut radius = 0.0;
    while radius < MAX_RADIUS && slope(radius + 0.01) > 0.0 {
        radius += 0.01;
    }
    radius
}

/// Returns the direction (x/z, y/z) whose distorted direction is given, by bisection on the rising part.
fn undistort(distorted: DVec2, k1: f64, k2: f64, limit: f64) -> DVec2 {
    let wanted = distorted.length();
    if wanted < 1e-9 {
        return distorted;
    }
    let (mut low, mut high) = (0.0, limit);
    for _ in 0..40 {
        let r = 0.5 * (low + high);
        if r * (1.0 + r * r * (k1 + r * r * k2)) < wanted {
            low = r;
        } else {
            high = r;
        }
    }
    distorted * (0.5 * (low + high) / wanted)
}

/// Returns the pinhole of the same focal lengths that shows all directions, within twice the sides.
fn around(lens: &Intrinsics, least: DVec2, greatest: DVec2) -> Intrinsics {
    let side = |low: f64, high: f64, focal_px: f64, given_px: u32| {
        let most = f64::from((2 * given_px).min(MAX_SIDE_PX));
        let before = (-low * focal_px).ceil().clamp(1.0, 0.5 * most);
        let after = (high * focal_px).ceil().clamp(1.0, 0.5 * most);
        (before, before + after)
    };
    let (cx_px, width) = side(least.x, greatest.x, lens.fx_px, lens.width_px);
    let (cy_px, height) = side(least.y, greatest.y, lens.fy_px, lens.height_px);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to image sides above")]
    let (width_px, height_px) = (width as u32, height as u32);
    Intrinsics { width_px, height_px, cx_px, cy_px, k1: 0.0, k2: 0.0, ..*lens }
}

fn source(pinhole: &Intrinsics, direction: DVec2) -> u32 {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the side")]
    let index = |at: f64, side: u32| at.floor().clamp(0.0, f64::from(side - 1)) as u32;
    let x = index(pinhole.cx_px + pinhole.fx_px * direction.x, pinhole.width_px);
    let y = index(pinhole.cy_px + pinhole.fy_px * direction.y, pinhole.height_px);
    y * pinhole.width_px + x
}

#[cfg(test)]
mod tests {
    use super::*;
    use ds_space::DVec3;
    use proptest::prelude::*;

    #[test]
    fn without_distortion_nothing_changes() {
        let lens = Lens::new(&Intrinsics::centred(8, 4, 1.0));
        assert_eq!(lens.develop((0..32).collect::<Vec<u32>>()), (0..32).collect::<Vec<u32>>());
    }

    proptest! {
        #[test]
        fn a_point_lands_where_the_camera_model_says(k1 in -0.25..0.25, k2 in -0.03..0.03, x in -3.0..3.0, y in -2.0..2.0) {
            let camera = Intrinsics { k1, k2, ..Intrinsics::centred(64, 40, 1.2) };
            let lens = Lens::new(&camera);
            let pixel = camera.project(DVec3::new(x, y, 8.0)).expect("the point is ahead");
            prop_assume!(pixel.x > 0.0 && pixel.x < 64.0 && pixel.y > 0.0 && pixel.y < 40.0);
            let sources = lens.sources.as_ref().expect("the lens distorts");
            let source = sources[pixel.y as usize * 64 + pixel.x as usize];
            let (at_x, at_y) = (source % lens.pinhole.width_px, source / lens.pinhole.width_px);
            let straight = lens.pinhole.project(DVec3::new(x, y, 8.0)).expect("the point is ahead");
            let off = (f64::from(at_x) + 0.5 - straight.x).abs().max((f64::from(at_y) + 0.5 - straight.y).abs());
            prop_assert!(off < 2.0, "{off} px off");
        }
    }
}

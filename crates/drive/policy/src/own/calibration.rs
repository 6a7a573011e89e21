//! The calibration inputs of a network: lens and mounting of its camera, for the image that it is given.
//!
//! Matrices row by row, in single precision. Radial distortion is not among them: a pinhole cannot say it.

use ds_nn::Array;
use ds_onnx::manifest::{CalibrationSection, Camera, ImageSection};
use ds_space::{CameraModel, DMat4, DVec3, DVec4, Intrinsics, Pose};

use super::{Views, raw};
use crate::camera::eye::known_camera;
use crate::error::PolicyError;

/// Returns the camera of the network's image.
pub(super) fn seen(image: &ImageSection, views: &Views<'_>) -> Result<CameraModel, PolicyError> {
    let (camera, size_px) = match &image.camera {
        Camera::Known => {
            let known = known_camera();
            let size_px = [known.intrinsics.width_px, known.intrinsics.height_px];
            (known, size_px)
        }
        Camera::Raw(id) => {
            let (camera, frames) = raw(id, views)?;
            let lens = &camera.intrinsics;
            let size_px =
                frames.last().map_or([lens.width_px, lens.height_px], |one| [one.width_px(), one.height_px()]);
            (camera.clone(), size_px)
        }
    };
    let intrinsics = camera.intrinsics.resized(size_px[0], size_px[1]).framed(&image.framing(size_px));
    Ok(CameraModel { intrinsics, ..camera })
}

/// Returns the inputs that the section names, in its order.
pub(super) fn arrays(section: &CalibrationSection, camera: &CameraModel) -> Vec<Array> {
    let lens = pinhole(&camera.intrinsics);
    let mount = matrix(&camera.rig_from_camera);
    let view = lens * matrix(&camera.rig_from_camera.inverse());
    let named =
        [(&section.intrinsics, lens, 3), (&section.rig_from_camera, mount, 4), (&section.image_from_rig, view, 4)];
    named.into_iter().filter(|(name, ..)| name.is_some()).map(|(_, matrix, side)| array(&matrix, side)).collect()
}

fn pinhole(lens: &Intrinsics) -> DMat4 {
    DMat4::from_cols(
        DVec4::new(lens.fx_px, 0.0, 0.0, 0.0),
        DVec4::new(0.0, lens.fy_px, 0.0, 0.0),
        DVec4::new(lens.cx_px, lens.cy_px, 1.0, 0.0),
        DVec4::W,
    )
}

fn matrix<To: ds_space::Frame, From: ds_space::Frame>(pose: &Pose<To, From>) -> DMat4 {
    DMat4::from_scale_rotation_translation(DVec3::ONE, pose.rotation, pose.translation)
}

#[expect(clippy::cast_possible_truncation, reason = "inputs are single precision")]
fn array(matrix: &DMat4, side: usize) -> Array {
    let rows = (0..side).flat_map(|row| (0..side).map(move |column| matrix.col(column)[row] as f32));
    Array::new(&[1, side, side], rows.collect())
}

#[cfg(test)]
mod tests {
    use ds_onnx::manifest::{Colour, Layout, Resize};
    use ds_raster::RgbImage;

    use super::*;

    #[test]
    fn a_point_of_the_road_lies_where_the_matrices_say() {
        let mut camera = known_camera();
        camera.intrinsics.cx_px += 3.0;
        let frame = RgbImage::filled(320, 192, [0; 3]);
        let views = [(&camera, std::slice::from_ref(&frame))];
        let image = |resize, size_px| ImageSection {
            input: "image".to_owned(),
            size_px,
            layout: Layout::Nchw,
            colour: Colour::Rgb,
            scale: 1.0,
            mean: [0.0; 3],
            std: [1.0; 3],
            history: 1,
            camera: Camera::Raw("front".to_owned()),
            resize,
        };
        let named = |name: &str| Some(name.to_owned());
        let section = CalibrationSection { intrinsics: named("K"), rig_from_camera: None, image_from_rig: named("P") };
        // A wide image cut to a square of its height loses 64 of 320 columns at each side, and is then halved.
        for (resize, size_px, left_px, scale) in [
            (Resize::Area, [80, 48], 0.0, 0.5),
            (Resize::Crop, [96, 96], 64.0, 0.5),
            (Resize::Area, [160, 96], 0.0, 1.0),
        ] {
            let seen = seen(&image(resize, size_px), &views).expect("the camera is there");
            let [lens, view] = &arrays(&section, &seen)[..] else { panic!("two inputs") };
            assert_eq!((lens.shape(), view.shape()), (&[1, 3, 3][..], &[1, 4, 4][..]));
            let point = [12.0, -2.0, 0.0, 1.0];
            let row = |row: usize| {
                (0..4).map(|column| f64::from(view.values()[4 * row + column]) * point[column]).sum::<f64>()
            };
            let in_camera = camera.rig_from_camera.inverse() * DVec3::new(12.0, -2.0, 0.0);
            let pixel = camera.intrinsics.project(in_camera).expect("ahead");
            let (x, y) = match resize {
                Resize::Area => (pixel.x * scale, pixel.y * scale),
                Resize::Crop => ((2.0 * pixel.x - left_px) * scale, 2.0 * pixel.y * scale),
            };
            assert!((row(0) / row(2) - x).abs() < 1e-3 && (row(1) / row(2) - y).abs() < 1e-3, "{resize:?} {size_px:?}");
            assert!((row(2) - in_camera.z).abs() < 1e-4 && (row(3) - 1.0).abs() < 1e-6);
        }
    }
}

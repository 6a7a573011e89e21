//! The pinhole camera with optional radial distortion, fixed on the rig.

use glam::{DQuat, DVec2, DVec3};

use crate::id::CameraId;
use crate::pose::{Camera, Pose, Rig};

/// Focal lengths, principal point and radial distortion of a camera, in pixels.
///
/// A camera-frame point (x, y, z) with z > 0 has the normalised coordinates u = x/z, v = y/z and
/// r² = u² + v²; its pixel is (cx + fx·u·d, cy + fy·v·d) with d = 1 + k1·r² + k2·r⁴.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// Image width, in pixels.
    pub width_px: u32,
    /// Image height, in pixels.
    pub height_px: u32,
    /// Focal length along x, in pixels.
    pub fx_px: f64,
    /// Focal length along y, in pixels.
    pub fy_px: f64,
    /// Principal point, x, in pixels from the left edge.
    pub cx_px: f64,
    /// Principal point, y, in pixels from the top edge.
    pub cy_px: f64,
    /// First radial distortion coefficient; 0 for none.
    pub k1: f64,
    /// Second radial distortion coefficient; 0 for none.
    pub k2: f64,
}

/// The part of an image that is kept, in its pixels, and the size that it is brought to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Framing {
    /// First column.
    pub left_px: u32,
    /// First row.
    pub top_px: u32,
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Width and height afterwards.
    pub to_px: [u32; 2],
}

impl Intrinsics {
    /// Makes a pinhole camera with its principal point at the centre of the image.
    #[must_use]
    pub fn centred(width_px: u32, height_px: u32, horizontal_fov_rad: f64) -> Self {
        let focal = 0.5 * f64::from(width_px) / (0.5 * horizontal_fov_rad).tan();
        Self {
            width_px,
            height_px,
            fx_px: focal,
            fy_px: focal,
            cx_px: 0.5 * f64::from(width_px),
            cy_px: 0.5 * f64::from(height_px),
            k1: 0.0,
            k2: 0.0,
        }
    }

    /// Returns the same camera for another image size, with the same field of view along each axis.
    #[must_use]
    pub fn resized(&self, width_px: u32, height_px: u32) -> Self {
        let sx = f64::from(width_px) / f64::from(self.width_px);
        let sy = f64::from(height_px) / f64::from(self.height_px);
        Self {
            width_px,
            height_px,
            fx_px: self.fx_px * sx,
            fy_px: self.fy_px * sy,
            cx_px: self.cx_px * sx,
            cy_px: self.cy_px * sy,
            ..*self
        }
    }

    /// Returns the largest part of the image that has the aspect of another size, as near to the principal point as the image
    /// allows, to be brought to that size.
    #[must_use]
    pub fn framing(&self, to_px: [u32; 2]) -> Framing {
        let [whole, to] = [[self.width_px, self.height_px], to_px].map(|size| size.map(|side| f64::from(side.max(1))));
        let part = (whole[0] / to[0]).min(whole[1] / to[1]);
        let span = |axis: usize, centre: f64| {
            let size = (part * to[axis]).round().clamp(1.0, whole[axis]);
            let from = (centre - 0.5 * size).round().clamp(0.0, whole[axis] - size);
            [from as u32, size as u32]
        };
        let ([left_px, width_px], [top_px, height_px]) = (span(0, self.cx_px), span(1, self.cy_px));
        Framing { left_px, top_px, width_px, height_px, to_px }
    }

    /// Returns the same camera with only a part of its image kept, brought to another size; distortion goes with the
    /// direction and stays what it is.
    #[must_use]
    pub fn framed(&self, framing: &Framing) -> Self {
        let part = Self {
            width_px: framing.width_px,
            height_px: framing.height_px,
            cx_px: self.cx_px - f64::from(framing.left_px),
            cy_px: self.cy_px - f64::from(framing.top_px),
            ..*self
        };
        part.resized(framing.to_px[0], framing.to_px[1])
    }

    /// Projects a camera-frame point to a pixel, or `None` at or behind the camera plane.
    #[must_use]
    pub fn project(&self, point_in_camera: DVec3) -> Option<DVec2> {
        if point_in_camera.z <= 1e-6 {
            return None;
        }
        let (u, v) = (point_in_camera.x / point_in_camera.z, point_in_camera.y / point_in_camera.z);
        let r2 = u * u + v * v;
        let d = 1.0 + r2 * (self.k1 + r2 * self.k2);
        Some(DVec2::new(self.cx_px + self.fx_px * u * d, self.cy_px + self.fy_px * v * d))
    }
}

/// A camera of the rig: its id, lens and mounting.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraModel {
    /// The camera's name, unique within the rig.
    pub id: CameraId,
    /// Lens and image size.
    pub intrinsics: Intrinsics,
    /// Mounting on the vehicle.
    pub rig_from_camera: Pose<Rig, Camera>,
}

impl CameraModel {
    /// Mounts a camera at `position_in_rig` (metres), turned by `yaw_rad` (left positive) and `pitch_rad`
    /// (down positive) from looking straight ahead.
    #[must_use]
    pub fn mounted(id: CameraId, intrinsics: Intrinsics, position_in_rig: DVec3, yaw_rad: f64, pitch_rad: f64) -> Self {
        // Camera axes in the rig when looking ahead: x right = -y, y down = -z, z forward = +x.
        let ahead = DQuat::from_mat3(&glam::DMat3::from_cols(DVec3::NEG_Y, DVec3::NEG_Z, DVec3::X));
        let rotation = DQuat::from_rotation_z(yaw_rad) * DQuat::from_rotation_y(pitch_rad) * ahead;
        Self { id, intrinsics, rig_from_camera: Pose::new(rotation.normalize(), position_in_rig) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_framed_camera_sees_the_same_points_where_its_part_of_the_image_is() {
        let portrait = Intrinsics { k1: -0.3, k2: 0.08, cy_px: 1100.0, ..Intrinsics::centred(1550, 2048, 0.8) };
        for (camera, to_px, height_px) in [
            (portrait, [160, 96], 930),
            (Intrinsics::centred(3840, 2160, 1.0), [160, 96], 2160),
            (Intrinsics::centred(80, 48, 1.0), [160, 96], 48),
        ] {
            let framing = camera.framing(to_px);
            assert_eq!(framing.height_px, height_px);
            assert!(framing.left_px + framing.width_px <= camera.width_px, "{framing:?}");
            assert!(framing.top_px + framing.height_px <= camera.height_px, "{framing:?}");
            let framed = camera.framed(&framing);
            assert_eq!([framed.width_px, framed.height_px], to_px);
            let point = DVec3::new(0.7, -0.4, 9.0);
            let (before, after) = (camera.project(point).expect("ahead"), framed.project(point).expect("ahead"));
            let scale = f64::from(to_px[0]) / f64::from(framing.width_px);
            let corner = DVec2::new(f64::from(framing.left_px), f64::from(framing.top_px));
            assert!(((before - corner) * scale - after).length() < 0.2, "{before} {after}");
        }
        // what fits already is left alone, to the bit
        let own = Intrinsics { cx_px: 79.3, k1: 0.1, ..Intrinsics::centred(160, 96, 1.2) };
        assert_eq!(own.framed(&own.framing([160, 96])), own);
    }

    #[test]
    fn a_point_ahead_left_and_below_lands_left_and_below_the_centre() {
        let id = CameraId::new("front").expect("a plain word is an id");
        let camera = CameraModel::mounted(id, Intrinsics::centred(160, 96, 1.2), DVec3::new(1.5, 0.0, 1.6), 0.0, 0.0);
        let point_in_camera = camera.rig_from_camera.inverse() * DVec3::new(20.0, 2.0, 0.0);
        let pixel = camera.intrinsics.project(point_in_camera).expect("the point is ahead");
        assert!(pixel.x < 80.0 && pixel.y > 48.0, "{pixel:?}");
        assert!((point_in_camera - DVec3::new(-2.0, 1.6, 18.5)).length() < 1e-9, "{point_in_camera:?}");
    }
}

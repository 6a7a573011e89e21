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
    fn a_point_ahead_left_and_below_lands_left_and_below_the_centre() {
        let id = CameraId::new("front").expect("a plain word is an id");
        let camera = CameraModel::mounted(id, Intrinsics::centred(160, 96, 1.2), DVec3::new(1.5, 0.0, 1.6), 0.0, 0.0);
        let point_in_camera = camera.rig_from_camera.inverse() * DVec3::new(20.0, 2.0, 0.0);
        let pixel = camera.intrinsics.project(point_in_camera).expect("the point is ahead");
        assert!(pixel.x < 80.0 && pixel.y > 48.0, "{pixel:?}");
        assert!((point_in_camera - DVec3::new(-2.0, 1.6, 18.5)).length() < 1e-9, "{point_in_camera:?}");
    }
}

//! Vectors, poses, sizes and cameras between values and messages.

use ds_space::{CameraId, CameraModel, DQuat, DVec2, DVec3, Intrinsics, Pose, PoseSe2};
use ds_world::Size;

use crate::error::FieldError;
use crate::field::{checked, extent, number, part, positive, whole};
use crate::v1;

/// The largest image side, in pixels.
pub const MAX_SIDE_PX: u32 = ds_raster::image::MAX_SIDE_PX;

impl From<DVec2> for v1::Vector2 {
    fn from(value: DVec2) -> Self {
        Self { x: Some(value.x), y: Some(value.y) }
    }
}

impl TryFrom<v1::Vector2> for DVec2 {
    type Error = FieldError;
    fn try_from(message: v1::Vector2) -> Result<Self, FieldError> {
        Ok(Self::new(number("x", message.x)?, number("y", message.y)?))
    }
}

impl From<DVec3> for v1::Vector3 {
    fn from(value: DVec3) -> Self {
        Self { x: Some(value.x), y: Some(value.y), z: Some(value.z) }
    }
}

impl TryFrom<v1::Vector3> for DVec3 {
    type Error = FieldError;
    fn try_from(message: v1::Vector3) -> Result<Self, FieldError> {
        Ok(Self::new(number("x", message.x)?, number("y", message.y)?, number("z", message.z)?))
    }
}

impl From<&PoseSe2> for v1::PoseSe2 {
    fn from(value: &PoseSe2) -> Self {
        Self { x_m: Some(value.position.x), y_m: Some(value.position.y), heading_rad: Some(value.heading_rad) }
    }
}

impl TryFrom<v1::PoseSe2> for PoseSe2 {
    type Error = FieldError;
    fn try_from(message: v1::PoseSe2) -> Result<Self, FieldError> {
        Ok(Self::new(
            number("x_m", message.x_m)?,
            number("y_m", message.y_m)?,
            number("heading_rad", message.heading_rad)?,
        ))
    }
}

impl From<&[DVec2]> for v1::Polyline {
    fn from(points: &[DVec2]) -> Self {
        Self { x_m: points.iter().map(|point| point.x).collect(), y_m: points.iter().map(|point| point.y).collect() }
    }
}

/// Takes the points of a polyline, at least so many.
pub(crate) fn points(field: &str, message: Option<v1::Polyline>, least: usize) -> Result<Vec<DVec2>, FieldError> {
    let message = message.unwrap_or_default();
    polyline(&message, least).map_err(|error| error.below(field))
}

/// Takes the points of a polyline, at least so many.
pub(crate) fn polyline(message: &v1::Polyline, least: usize) -> Result<Vec<DVec2>, FieldError> {
    let (xs, ys) = (&message.x_m, &message.y_m);
    if xs.len() != ys.len() {
        return Err(FieldError::new("y_m", format!("has {} elements, x_m has {}", ys.len(), xs.len())));
    }
    if xs.len() < least {
        return Err(FieldError::new("", format!("has {} points, at least {least} are needed", xs.len())));
    }
    let point = |(index, (x, y)): (usize, (&f64, &f64))| {
        let x = number("", Some(*x)).map_err(|error| error.within("x_m", index))?;
        let y = number("", Some(*y)).map_err(|error| error.within("y_m", index))?;
        Ok(DVec2::new(x, y))
    };
    xs.iter().zip(ys).enumerate().map(point).collect()
}

impl<To, From> std::convert::From<&Pose<To, From>> for v1::Pose3
where
    To: ds_space::Frame,
    From: ds_space::Frame,
{
    fn from(value: &Pose<To, From>) -> Self {
        let rotation = value.rotation;
        Self {
            qx: Some(rotation.x),
            qy: Some(rotation.y),
            qz: Some(rotation.z),
            qw: Some(rotation.w),
            translation_m: Some(value.translation.into()),
        }
    }
}

impl<To: ds_space::Frame, From: ds_space::Frame> TryFrom<v1::Pose3> for Pose<To, From> {
    type Error = FieldError;
    fn try_from(message: v1::Pose3) -> Result<Self, FieldError> {
        let components = [
            number("qx", message.qx)?,
            number("qy", message.qy)?,
            number("qz", message.qz)?,
            number("qw", message.qw)?,
        ];
        Ok(Self::new(rotation("qw", components)?, part("translation_m", message.translation_m)?))
    }
}

/// Takes a unit quaternion (x, y, z, w).
pub(crate) fn rotation(field: &str, components: [f64; 4]) -> Result<DQuat, FieldError> {
    let rotation = DQuat::from_array(components);
    let length = rotation.length();
    if (length - 1.0).abs() > 1e-6 {
        return Err(FieldError::new(field, format!("belongs to a quaternion of length {length}, not 1")));
    }
    Ok(rotation)
}

impl From<&Size> for v1::Size {
    fn from(value: &Size) -> Self {
        Self { length_m: Some(value.length_m), width_m: Some(value.width_m), height_m: Some(value.height_m) }
    }
}

impl TryFrom<v1::Size> for Size {
    type Error = FieldError;
    fn try_from(message: v1::Size) -> Result<Self, FieldError> {
        Ok(Self {
            length_m: extent("length_m", message.length_m)?,
            width_m: extent("width_m", message.width_m)?,
            height_m: extent("height_m", message.height_m)?,
        })
    }
}

impl From<&Intrinsics> for v1::Intrinsics {
    fn from(value: &Intrinsics) -> Self {
        Self {
            width_px: value.width_px,
            height_px: value.height_px,
            fx_px: Some(value.fx_px),
            fy_px: Some(value.fy_px),
            cx_px: Some(value.cx_px),
            cy_px: Some(value.cy_px),
            k1: Some(value.k1),
            k2: Some(value.k2),
        }
    }
}

impl TryFrom<v1::Intrinsics> for Intrinsics {
    type Error = FieldError;
    fn try_from(message: v1::Intrinsics) -> Result<Self, FieldError> {
        Ok(Self {
            width_px: whole("width_px", message.width_px, 1, MAX_SIDE_PX)?,
            height_px: whole("height_px", message.height_px, 1, MAX_SIDE_PX)?,
            fx_px: positive("fx_px", message.fx_px)?,
            fy_px: positive("fy_px", message.fy_px)?,
            cx_px: number("cx_px", message.cx_px)?,
            cy_px: number("cy_px", message.cy_px)?,
            k1: number("k1", message.k1)?,
            k2: number("k2", message.k2)?,
        })
    }
}

impl From<&CameraModel> for v1::CameraModel {
    fn from(value: &CameraModel) -> Self {
        Self {
            id: value.id.as_str().to_owned(),
            intrinsics: Some((&value.intrinsics).into()),
            rig_from_camera: Some((&value.rig_from_camera).into()),
        }
    }
}

impl TryFrom<v1::CameraModel> for CameraModel {
    type Error = FieldError;
    fn try_from(message: v1::CameraModel) -> Result<Self, FieldError> {
        Ok(Self {
            id: checked("id", CameraId::new(&message.id))?,
            intrinsics: part("intrinsics", message.intrinsics)?,
            rig_from_camera: part("rig_from_camera", message.rig_from_camera)?,
        })
    }
}

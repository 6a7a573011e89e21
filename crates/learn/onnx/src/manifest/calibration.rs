//! The table `[calibration]`: which inputs tell how the camera sees.

use serde::Deserialize;

use crate::network::Named;

/// `[calibration]`: lens and mounting of the camera of `[image]`, for the image that the network is given. Each is an input.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationSection {
    /// [1, 3, 3]: the pinhole, in pixels.
    pub intrinsics: Option<String>,
    /// [1, 4, 4]: takes a point from the camera (x right, y down, z forward) to the rig.
    pub rig_from_camera: Option<String>,
    /// [1, 4, 4]: takes a point of the rig to (u·z, v·z, z, 1), u and v being its pixel and z its depth.
    pub image_from_rig: Option<String>,
}

impl CalibrationSection {
    /// Returns the inputs that it names.
    pub(super) fn inputs(&self) -> Vec<Named> {
        let named = [(&self.intrinsics, 3), (&self.rig_from_camera, 4), (&self.image_from_rig, 4)];
        let input =
            |(name, side): (&Option<String>, usize)| Some(Named { name: name.clone()?, shape: vec![1, side, side] });
        named.into_iter().filter_map(input).collect()
    }
}

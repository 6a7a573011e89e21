//! `focal_error`: the focal length is longer than nominal by a share.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "focal_error",
    insertion: Insertion::Camera,
    parameters: &[Parameter::linear("share", "1", (-0.08, 0.08)).usual(0.0, 0.001)],
    needs: &[Needs::Picture],
    act: Act::Warp(|values, context, at| {
        let c = context.camera;
        let scale = 1.0 / (1.0 + values[0]);
        [c.cx + (at[0] - c.cx) * scale, c.cy + (at[1] - c.cy) * scale]
    }),
};

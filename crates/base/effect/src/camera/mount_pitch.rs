//! `mount_pitch`: the camera looks up or down; nose down positive.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "mount_pitch",
    insertion: Insertion::Camera,
    parameters: &[Parameter::linear("angle", "deg", (-3.0, 3.0)).usual(0.0, 0.04)],
    needs: &[Needs::Picture],
    act: Act::Warp(|values, context, at| {
        let (sin, cos) = values[0].to_radians().sin_cos();
        let c = context.camera;
        let (x, y) = ((at[0] - c.cx) / c.fx, (at[1] - c.cy) / c.fy);
        let ahead = cos - y * sin;
        [c.cx + c.fx * x / ahead, c.cy + c.fy * (y * cos + sin) / ahead]
    }),
};

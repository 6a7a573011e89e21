//! `mount_position`: the camera sits elsewhere: left and up of nominal; near things shift by offset over depth.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "mount_position",
    insertion: Insertion::Camera,
    parameters: &[Parameter::linear("left", "m", (-0.5, 0.5)), Parameter::linear("up", "m", (-0.5, 0.5))],
    needs: &[Needs::Depth],
    act: Act::Warp(|values, context, at| {
        let c = context.camera;
        let Some(depth_m) = context.depth_at(at) else { return at };
        [at[0] - c.fx * values[0] / depth_m, at[1] - c.fy * values[1] / depth_m]
    }),
};

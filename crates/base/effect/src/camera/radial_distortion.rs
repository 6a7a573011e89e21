//! `radial_distortion`: the lens distorts, r_d = r (1 + k1 r²) with r in focal lengths.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "radial_distortion",
    insertion: Insertion::Camera,
    parameters: &[Parameter::linear("k1", "1", (-0.3, 0.3)).usual(0.0, 0.003)],
    needs: &[Needs::Picture],
    act: Act::Warp(|values, context, at| {
        let c = context.camera;
        let (x, y) = ((at[0] - c.cx) / c.fx, (at[1] - c.cy) / c.fy);
        // r from r_d by fixed-point steps; they converge for 3 |k1| r² < 1
        let mut scale = 1.0;
        for _ in 0..6 {
            scale = 1.0 / (1.0 + values[0] * (x * x + y * y) * scale * scale);
        }
        [c.cx + c.fx * x * scale, c.cy + c.fy * y * scale]
    }),
};

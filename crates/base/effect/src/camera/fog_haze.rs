//! `fog_haze`: contrast falls with distance, L exp(-beta d) + airlight (1 - exp(-beta d)), linear light.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "fog_haze",
    insertion: Insertion::Camera,
    parameters: &[
        Parameter::linear("beta", "1/m", (0.0, 0.06)),
        Parameter::linear("airlight", "1", (0.2, 1.2)).absent_at(0.8),
    ],
    needs: &[Needs::Depth],
    act: Act::Edit(|values, context, _, picture| {
        let Some(depth) = context.depth_m else { return };
        let (beta, air, width) = (values[0] as f32, values[1] as f32, picture.width);
        picture.edit_light(|x, y, light| {
            let clear = (-beta * depth[y * width + x]).exp();
            for l in light {
                *l = *l * clear + air * (1.0 - clear);
            }
        });
    }),
};

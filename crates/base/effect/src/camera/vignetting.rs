//! `vignetting`: light is lost towards the corners, 1 - loss (r / r_corner)^power.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
use crate::picture::power;
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "vignetting",
    insertion: Insertion::Camera,
    parameters: &[
        Parameter::linear("loss", "1", (0.0, 0.7)),
        Parameter::linear("power", "1", (2.0, 4.0)).absent_at(2.0),
    ],
    needs: &[Needs::Picture],
    act: Act::Edit(|values, context, _, picture| {
        let (loss, half_power) = (values[0] as f32, 0.5 * values[1] as f32);
        let half = [context.size[0] as f32 / 2.0, context.size[1] as f32 / 2.0];
        let corner = 1.0 / (half[0] * half[0] + half[1] * half[1]);
        picture.scale_light(|x, y| {
            let (u, v) = (x as f32 + 0.5 - half[0], y as f32 + 0.5 - half[1]);
            1.0 - loss * power((u * u + v * v) * corner, half_power)
        });
    }),
};

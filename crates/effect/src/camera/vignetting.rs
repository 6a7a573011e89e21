//! `vignetting`: light is lost towards the corners, 1 - loss (r / r_corner)^power.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
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
        picture.scale_light(|x, y| (1.0 - values[0] * context.radius(x, y).powf(values[1])) as f32);
    }),
};

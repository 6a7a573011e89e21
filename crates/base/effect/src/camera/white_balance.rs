//! `white_balance`: red and blue gains differ from nominal, in linear light.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
use crate::picture::ENCODING;
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "white_balance",
    insertion: Insertion::Camera,
    parameters: &[
        Parameter::linear("red", "1", (-0.3, 0.3)).usual(0.0, 0.004),
        Parameter::linear("blue", "1", (-0.3, 0.3)).usual(0.0, 0.004),
    ],
    needs: &[Needs::Colour],
    act: Act::Edit(|values, _, _, picture| {
        if picture.channels < 3 {
            return;
        }
        let [red, blue] = [values[0], values[1]].map(|v| (1.0 + v).max(0.0).powf(1.0 / f64::from(ENCODING)) as f32);
        for pixel in picture.data.chunks_exact_mut(3) {
            pixel[0] = (pixel[0] * red).min(255.0);
            pixel[2] = (pixel[2] * blue).min(255.0);
        }
    }),
};

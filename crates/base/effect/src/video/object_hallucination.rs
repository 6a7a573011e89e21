//! `object_hallucination`: things appear where the layout has no object: a patch of the frame is shown again elsewhere.
//! The neutral value leaves the frame untouched.

use super::patch;
use crate::frame::{Act, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "object_hallucination",
    insertion: Insertion::VideoModel,
    parameters: &[Parameter::linear("rate", "per frame", (0.0, 3.0))],
    needs: &[Needs::Picture],
    act: Act::Edit(|values, context, _, picture| {
        let draws = context.draws("object_hallucination", false);
        let count = (values[0] + draws.uniform(0)).floor() as u64;
        let (width, height) = (picture.width as f64, picture.height as f64);
        for k in 0..count {
            let draw = |i: u64, low: f64, high: f64| low + (high - low) * draws.uniform(1 + k * 8 + i);
            let size = [width * draw(0, 0.06, 0.15), height * draw(1, 0.12, 0.25)];
            let from = [draw(2, 0.0, 0.8) * width, draw(3, 0.4, 0.7) * height];
            let to = [draw(4, 0.0, 0.8) * width, draw(5, 0.4, 0.7) * height];
            patch::copy(picture, from, to, size);
        }
    }),
};

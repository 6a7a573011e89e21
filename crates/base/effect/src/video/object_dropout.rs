//! `object_dropout`: objects of the layout are missing from the frame; their boxes are filled from left and right.
//! The neutral value leaves the frame untouched.

use super::patch;
use crate::frame::{Act, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "object_dropout",
    insertion: Insertion::VideoModel,
    parameters: &[Parameter::linear("probability", "1", (0.0, 1.0))],
    needs: &[Needs::Boxes],
    act: Act::Edit(|values, context, _, picture| {
        let draws = context.draws("object_dropout", false);
        for (k, layout) in (0..).zip(context.boxes) {
            if layout.class == "car" && draws.uniform(k) < values[0] {
                patch::fill(picture, layout.edges);
            }
        }
    }),
};

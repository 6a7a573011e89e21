//! `layout_misalignment`: objects are drawn beside the places that the layout gives them, each by its own offset.
//! The neutral value leaves the frame untouched.

use super::patch;
use crate::frame::{Act, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "layout_misalignment",
    insertion: Insertion::VideoModel,
    parameters: &[Parameter::linear("offset", "px", (0.0, 12.0))],
    needs: &[Needs::Boxes],
    act: Act::Edit(|values, context, _, picture| {
        let draws = context.draws("layout_misalignment", true);
        for (k, layout) in (0..).zip(context.boxes) {
            let [x0, y0, x1, y1] = layout.edges;
            let moved = [x0 + values[0] * draws.normal(2 * k), y0 + values[0] * draws.normal(2 * k + 1)];
            let object = picture.clone();
            patch::fill(picture, layout.edges);
            patch::paste(picture, &object, [x0, y0], moved, [x1 - x0, y1 - y0]);
        }
    }),
};

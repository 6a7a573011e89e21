//! `identity_switch`: objects change their looks from one frame to the next while their boxes stay.
//! The neutral value leaves the frame untouched.

use super::patch;
use crate::frame::{Act, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "identity_switch",
    insertion: Insertion::VideoModel,
    parameters: &[Parameter::linear("rate", "per box and frame", (0.0, 1.0))],
    needs: &[Needs::Boxes],
    act: Act::Edit(|values, context, _, picture| {
        let draws = context.draws("identity_switch", false);
        for (k, layout) in (0..).zip(context.boxes) {
            if draws.uniform(3 * k) < values[0] {
                patch::restyle(picture, layout.edges, (0.6 + 0.8 * draws.uniform(3 * k + 1)) as f32);
            }
        }
    }),
};

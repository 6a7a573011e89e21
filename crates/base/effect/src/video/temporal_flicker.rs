//! `temporal_flicker`: the exposure of generated frames flickers: ln brightness, half global, half smooth over the picture, white in time.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "temporal_flicker",
    insertion: Insertion::VideoModel,
    parameters: &[Parameter::linear("sd", "ln", (0.0, 0.3))],
    needs: &[Needs::Sequence],
    act: Act::Edit(|values, context, _, picture| {
        let draws = context.draws("temporal_flicker", false);
        let sd = values[0] * 0.5f64.sqrt();
        let (width, height) = (picture.width as f64, picture.height as f64);
        let knots: [f64; 10] = std::array::from_fn(|k| draws.normal(k as u64));
        picture.scale_light(|x, y| {
            // a 3 x 3 grid of draws, smooth in between
            let (u, v) = (2.0 * x as f64 / width, 2.0 * y as f64 / height);
            let (i, j) = (u as usize, v as usize);
            let (fu, fv) = (u - i as f64, v - j as f64);
            let knot = |i: usize, j: usize| knots[1 + j * 3 + i];
            let smooth = (1.0 - fv) * ((1.0 - fu) * knot(i, j) + fu * knot(i + 1, j))
                + fv * ((1.0 - fu) * knot(i, j + 1) + fu * knot(i + 1, j + 1));
            (sd * (knots[0] + smooth)).exp() as f32
        });
    }),
};

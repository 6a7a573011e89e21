//! `defocus`: the lens is out of focus: an average over a disc, linear light.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "defocus",
    insertion: Insertion::Camera,
    parameters: &[Parameter::linear("radius", "px", (0.0, 4.0))],
    needs: &[Needs::Picture],
    act: Act::Edit(|values, _, _, picture| {
        let taps = disc(values[0]);
        *picture = picture.convolved(&taps);
    }),
};

/// Returns offsets and weights of a disc; pixels on the rim count by their share.
fn disc(radius_px: f64) -> Vec<([isize; 2], f32)> {
    let reach = radius_px.ceil() as i32;
    let mut taps = Vec::new();
    for y in -reach..=reach {
        for x in -reach..=reach {
            let weight = (0..25).filter(|k| {
                let (sx, sy) = (f64::from(k % 5) / 5.0 - 0.4, f64::from(k / 5) / 5.0 - 0.4);
                (f64::from(x) + sx).hypot(f64::from(y) + sy) <= radius_px.max(0.1)
            });
            let weight = weight.count() as f32;
            if weight > 0.0 {
                taps.push(([x as isize, y as isize], weight));
            }
        }
    }
    taps
}

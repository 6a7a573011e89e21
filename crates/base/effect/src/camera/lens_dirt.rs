//! `lens_dirt`: blobs on the lens that veil fixed places of the picture, I (1 - o) + veil o with a soft rim.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "lens_dirt",
    insertion: Insertion::Camera,
    parameters: &[
        Parameter::linear("opacity", "1", (0.0, 0.95)),
        Parameter::linear("blobs", "1", (0.0, 60.0)).absent_at(8.0),
        Parameter::linear("veil", "levels", (0.0, 255.0)).absent_at(70.0),
    ],
    needs: &[Needs::Picture],
    act: Act::Edit(|values, context, _, picture| {
        let draws = context.draws("lens_dirt", true);
        let (width, height) = (picture.width as f64, picture.height as f64);
        let mut clear = vec![1.0f32; picture.width * picture.height];
        for blob in 0..values[1].max(0.0).round() as u64 {
            let draw = |k: u64| draws.uniform(blob * 4 + k);
            let (x, y, radius) = (draw(0) * width, draw(1) * height, height * (0.04 + 0.12 * draw(2)));
            for (k, clear) in clear.iter_mut().enumerate() {
                let far = ((k % picture.width) as f64 - x).hypot((k / picture.width) as f64 - y) / radius;
                if far < 1.0 {
                    *clear *= 1.0 - (values[0] * (1.0 - far * far)) as f32;
                }
            }
        }
        for (k, value) in picture.data.iter_mut().enumerate() {
            let clear = clear[k / picture.channels];
            *value = *value * clear + values[2] as f32 * (1.0 - clear);
        }
    }),
};

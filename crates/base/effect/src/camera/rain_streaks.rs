//! `rain_streaks`: thin bright streaks that fall in every frame anew.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "rain_streaks",
    insertion: Insertion::Camera,
    parameters: &[
        Parameter::linear("count", "streaks per frame", (0.0, 800.0)),
        Parameter::linear("strength", "levels", (0.0, 120.0)).absent_at(40.0),
    ],
    needs: &[Needs::Picture],
    act: Act::Edit(|values, context, _, picture| {
        let draws = context.draws("rain_streaks", false);
        let (width, height) = (picture.width as f64, picture.height as f64);
        for streak in 0..values[0].max(0.0).round() as u64 {
            let draw = |k: u64, low: f64, high: f64| low + (high - low) * draws.uniform(streak * 8 + k);
            let (x, y) = (draw(0, 0.0, width), draw(1, -0.1, 1.0) * height);
            let (length, slant) = (height * draw(2, 0.04, 0.16), draw(3, -0.15, 0.05));
            let gain = (values[1] * draw(4, 0.5, 1.0)) as f32;
            for step in 0..length.round() as i64 {
                let (px, py) = ((x + slant * step as f64) as i64, y as i64 + step);
                if (0..picture.width as i64).contains(&px) && (0..picture.height as i64).contains(&py) {
                    let start = (py as usize * picture.width + px as usize) * picture.channels;
                    for value in &mut picture.data[start..start + picture.channels] {
                        *value = (*value + gain).min(255.0);
                    }
                }
            }
        }
    }),
};

//! `texture_washing`: fine detail of low contrast is lost while edges stay.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "texture_washing",
    insertion: Insertion::VideoModel,
    parameters: &[
        Parameter::linear("share", "1", (0.0, 1.0)),
        Parameter::linear("contrast", "levels", (2.0, 60.0)).absent_at(12.0),
    ],
    needs: &[Needs::Picture],
    act: Act::Edit(|values, _, _, picture| {
        let smooth = picture.boxed(2);
        let (share, contrast) = (values[0] as f32, values[1] as f32);
        for (value, smooth) in picture.data.iter_mut().zip(&smooth.data) {
            let detail = *value - smooth;
            *value -= share * detail * (-(detail / contrast).powi(2)).exp();
        }
    }),
};

//! `gamma`: a global tone curve, an exponent on encoded values.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
use crate::picture::power;
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "gamma",
    insertion: Insertion::Camera,
    parameters: &[Parameter::linear("exponent", "1", (0.6, 1.6)).absent_at(1.0).usual(1.0, 0.005)],
    needs: &[Needs::Picture],
    act: Act::Edit(|values, _, _, picture| {
        let exponent = values[0] as f32;
        for value in &mut picture.data {
            *value = 255.0 * power(value.clamp(0.0, 255.0) / 255.0, exponent);
        }
    }),
};

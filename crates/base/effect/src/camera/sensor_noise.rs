//! `sensor_noise`: noise on encoded values: read noise everywhere and shot noise that grows with the root of brightness.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "sensor_noise",
    insertion: Insertion::Camera,
    parameters: &[Parameter::linear("read", "levels", (0.0, 20.0)), Parameter::linear("shot", "levels", (0.0, 20.0))],
    needs: &[Needs::Picture],
    act: Act::Edit(|values, context, _, picture| {
        let draws = context.draws("sensor_noise", false);
        for (k, value) in (0..).zip(&mut picture.data) {
            let sd = (values[0].powi(2) + values[1].powi(2) * f64::from(*value) / 255.0).max(0.0).sqrt();
            *value = (*value + (sd * draws.normal(k)) as f32).clamp(0.0, 255.0);
        }
    }),
};

//! `exposure_lag`: the exposure follows the illumination of the scene with a first-order lag; linear light.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "exposure_lag",
    insertion: Insertion::Camera,
    parameters: &[Parameter::linear("time_constant", "s", (0.0, 1.5))],
    needs: &[Needs::Light],
    act: Act::Edit(|values, context, memory, picture| {
        let before = memory.level.unwrap_or(context.light);
        let share = 1.0 - (-(context.time_secs - memory.time_secs).max(0.0) / values[0].max(1e-6)).exp();
        let level = before + (context.light - before) * share;
        memory.level = Some(level);
        let gain = (context.light / level) as f32;
        if (gain - 1.0).abs() > 1e-6 {
            picture.scale_light(|_, _| gain);
        }
    }),
};

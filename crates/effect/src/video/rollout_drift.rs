//! `rollout_drift`: generated frames drift away from the last anchor: more contrast, darker, warmer, washed.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "rollout_drift",
    insertion: Insertion::VideoModel,
    parameters: &[Parameter::linear("per_100", "1 per 100 frames", (0.0, 6.0))],
    needs: &[Needs::Sequence],
    act: Act::Edit(|values, context, _, picture| {
        let drift = (values[0] * context.frames_since_anchor / 100.0) as f32;
        if drift <= 0.0 {
            return;
        }
        let smooth = picture.boxed(2);
        let channels = picture.channels;
        for (k, (value, smooth)) in picture.data.iter_mut().zip(&smooth.data).enumerate() {
            let warm = if channels == 3 { [WARMER, 0.0, -WARMER][k % 3] } else { 0.0 };
            let detail = *value - smooth;
            let washed = *value - WASHED * drift * detail * (-(detail / 12.0).powi(2)).exp();
            let contrasted = 128.0 + (washed - 128.0) * (1.0 + CONTRAST * drift);
            *value = (contrasted * (1.0 + (warm - DARKER) * drift)).clamp(0.0, 255.0);
        }
    }),
};

/// Gain of contrast about mid grey per unit of drift.
const CONTRAST: f32 = 0.5;
/// Loss of brightness per unit of drift.
const DARKER: f32 = 0.2;
/// Gain of red and loss of blue per unit of drift.
const WARMER: f32 = 0.1;
/// Share of fine detail lost per unit of drift.
const WASHED: f32 = 0.8;

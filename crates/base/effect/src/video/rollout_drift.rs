//! `rollout_drift`: generated frames drift away from the last anchor: contrast up about the mean, darker, warmer, fine
//! detail washed; in proportion to the frames since the anchor. The slopes per unit of drift are those of the labelled
//! practice case. The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
use crate::picture::light_of;
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "rollout_drift",
    insertion: Insertion::VideoModel,
    parameters: &[
        Parameter::linear("per_100", "1 per 100 frames", (0.0, 8.0)),
        Parameter::linear("darker", "1", (-0.3, 0.8)).absent_at(0.07),
        Parameter::linear("warmer", "1", (-0.3, 0.5)).absent_at(0.1),
    ],
    needs: &[Needs::Sequence],
    act: Act::Edit(|values, context, _, picture| {
        let drift = (values[0] * context.frames_since_anchor / 100.0) as f32;
        if drift <= 0.0 {
            return;
        }
        let (darker, warmer) = (values[1] as f32, values[2] as f32);
        let smooth = picture.boxed(2);
        for (value, smooth) in picture.data.iter_mut().zip(&smooth.data) {
            let detail = *value - smooth;
            *value -= (WASHED * drift).min(1.0) * detail * (-(detail / 12.0).powi(2)).exp();
        }
        let mean = picture.data.iter().map(|v| light_of(*v)).sum::<f32>() / picture.data.len() as f32;
        let tint = if picture.channels == 3 { [warmer, 0.0, -warmer] } else { [0.0; 3] };
        picture.edit_light(|_, _, light| {
            for (l, tint) in light.iter_mut().zip(tint) {
                *l = (mean + (*l - mean) * (1.0 + CONTRAST * drift)) * (1.0 + (tint - darker) * drift);
            }
        });
    }),
};

/// Gain of contrast about the mean of light per unit of drift.
const CONTRAST: f32 = 0.45;
/// Share of fine detail lost per unit of drift.
const WASHED: f32 = 0.8;

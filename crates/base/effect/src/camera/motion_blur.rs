//! `motion_blur`: the scene moves over the picture while the shutter is open; an average along the flow, linear light.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "motion_blur",
    insertion: Insertion::Camera,
    parameters: &[Parameter::linear("shutter", "ms", (0.0, 40.0))],
    needs: &[Needs::Motion],
    act: Act::Edit(|values, context, _, picture| {
        let open_secs = values[0] * 1e-3;
        *picture = picture.spread(|x, y, taps| {
            let flow = context.flow([x as f64, y as f64]).unwrap_or([0.0; 2]);
            let streak = flow.map(|f| (f * open_secs).clamp(-24.0, 24.0) as f32);
            let count = streak[0].hypot(streak[1]).ceil().clamp(1.0, 16.0) as usize;
            let share = |k: usize| (k as f32 + 0.5) / count as f32 - 0.5;
            taps.extend((0..count).map(|k| ([streak[0] * share(k), streak[1] * share(k)], 1.0)));
        });
    }),
};

//! `night_illumination`: the scene is lit by an ambient share and by headlamps on the near road; linear light.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameContext, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "night_illumination",
    insertion: Insertion::Camera,
    parameters: &[
        Parameter::linear("ambient", "x", (0.02, 1.0)).absent_at(1.0),
        Parameter::linear("headlamp", "x", (0.0, 2.0)),
    ],
    needs: &[Needs::Depth],
    act: Act::Edit(|values, context, _, picture| {
        picture.scale_light(|x, y| (values[0] + values[1] * cone(context, [x as f64, y as f64])) as f32);
    }),
};

/// Returns how much headlamp light reaches a place: a lobe 0.3 rad wide, dipped below the horizon, fading over 25 m.
fn cone(context: &FrameContext<'_>, at: [f64; 2]) -> f64 {
    let c = context.camera;
    let (x, y) = ((at[0] - c.cx) / c.fx, (at[1] - c.cy) / c.fy);
    let depth_m = context.depth_at(at).unwrap_or(20.0);
    let across = (-(x / 0.3).powi(2) / 2.0).exp();
    let down = 1.0 / (1.0 + (-(y - 0.02) / 0.02).exp());
    across * down / (1.0 + (depth_m / 25.0).powi(2))
}

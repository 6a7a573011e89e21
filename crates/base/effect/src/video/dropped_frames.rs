//! `dropped_frames`: some frames are lost and the one before is shown again.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameContext, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "dropped_frames",
    insertion: Insertion::Transport,
    parameters: &[Parameter::linear("rate", "1", (0.0, 0.6))],
    needs: &[Needs::Sequence],
    act: Act::Age(|values, context| {
        let lost = |back: u64| {
            let frame = FrameContext { frame: context.frame - back, ..context.clone() };
            frame.draws("dropped_frames", false).uniform(0) < values[0]
        };
        (0..context.frame.min(6)).take_while(|back| lost(*back)).count()
    }),
};

//! `obs_latency`: what arrives is older than its place in the sequence, and its stamp says so.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "obs_latency",
    insertion: Insertion::Transport,
    parameters: &[Parameter::linear("age", "frames", (0.0, 6.0))],
    needs: &[Needs::Sequence],
    act: Act::Age(|values, _| values[0].round().max(0.0) as usize),
};

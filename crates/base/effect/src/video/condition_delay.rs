//! `condition_delay`: frames show a condition that is some frames old, while their stamps agree with the simulator.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "condition_delay",
    insertion: Insertion::VideoModel,
    parameters: &[Parameter::linear("age", "frames", (0.0, 6.0))],
    needs: &[Needs::Sequence],
    act: Act::Age(|values, _| values[0].round().max(0.0) as usize),
};

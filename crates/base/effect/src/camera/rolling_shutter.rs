//! `rolling_shutter`: rows are read out one after the other, line time in µs times sensor rows; the middle row has the stamp.
//! The neutral value leaves the frame untouched.

use crate::frame::{Act, FrameEffect, Needs};
use crate::{Insertion, Parameter};

pub(crate) const EFFECT: FrameEffect = FrameEffect {
    id: "rolling_shutter",
    insertion: Insertion::Camera,
    parameters: &[Parameter::linear("line_time", "us", (0.0, 40.0))],
    needs: &[Needs::Motion],
    act: Act::Warp(|values, context, at| {
        let Some(flow) = context.flow(at) else { return at };
        let row = (at[1] + 0.5) / context.size[1] as f64 - 0.5;
        let late_secs = values[0] * 1e-6 * context.sensor_rows * row;
        [at[0] - flow[0] * late_secs, at[1] - flow[1] * late_secs]
    }),
};

//! What a moment of a window is like, as numbers near one: the state and the commands that a discrepancy of the nominal
//! simulator may go with, at the moment and added up since the window's start.

use crate::windows::{Anchor, BLOCK, BLOCKS, EgoRecord, Moment};
use ds_diagnosis::table::STEP_SECS;

/// Names of the quantities of one moment.
pub const NAMES: [&str; STATE] = [
    "one",
    "v",
    "v2",
    "ay",
    "abs_ay",
    "traction",
    "brake",
    "steer",
    "steer_rate",
    "v_ay",
    "ay_abs_ay",
    "ay_traction",
    "ay_brake",
    "abs_steer_rate",
];
/// Largest size of any of them.
pub(crate) const LARGEST: f64 = 5.0;
/// Quantities of one moment.
pub(crate) const STATE: usize = 14;
/// Features of one block: the moment's, and those added up once and twice over the time since the start.
pub(crate) const FEATURES: usize = 3 * STATE;

/// Returns the quantities of a moment: v over 15 m/s, lateral acceleration over 3 m/s², requested acceleration over
/// 1.5 m/s², steering in tenths of a radian and its rate in fifths of a radian per second.
#[must_use]
pub(crate) fn state(moment: &Moment) -> [f64; STATE] {
    let v = moment.speed_mps / 15.0;
    let ay = moment.speed_mps * moment.yaw_rate / 3.0;
    let (traction, brake) = (moment.accel_mps2.max(0.0) / 1.5, (-moment.accel_mps2).max(0.0) / 1.5);
    let (steer, rate) = (10.0 * moment.steer_rad, 5.0 * moment.steer_rate);
    let all = [
        1.0,
        v,
        v * v,
        ay,
        ay.abs(),
        traction,
        brake,
        steer,
        rate,
        v * ay,
        ay * ay.abs(),
        ay * traction,
        ay * brake,
        rate.abs(),
    ];
    all.map(|value| value.clamp(-LARGEST, LARGEST))
}

/// Returns the features of every block of a window.
#[must_use]
pub(crate) fn blocks(record: &EgoRecord, anchor: &Anchor) -> Vec<[f64; FEATURES]> {
    let mut sum = [0.0; STATE];
    let mut out = Vec::with_capacity(BLOCKS);
    for block in 0..BLOCKS {
        let mut here = [0.0; STATE];
        for k in 0..BLOCK {
            let now = state(&record.moment(anchor.sample + 1 + block * BLOCK + k));
            here.iter_mut().zip(now).for_each(|(sum, value)| *sum += value / BLOCK as f64);
        }
        sum.iter_mut().zip(here).for_each(|(sum, value)| *sum += value * BLOCK as f64 * STEP_SECS);
        let h = (block as f64 + 0.5) * BLOCK as f64 * STEP_SECS;
        let mut features = [0.0; FEATURES];
        for k in 0..STATE {
            features[k] = here[k];
            features[STATE + k] = sum[k];
            features[2 * STATE + k] = 0.5 * h * sum[k];
        }
        out.push(features);
    }
    out
}

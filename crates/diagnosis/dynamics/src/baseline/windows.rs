//! What healthy logs leave in single windows, as a file keeps it: what a watch compares the windows of a further log with.

use serde::{Deserialize, Serialize};

/// What one window leaves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Scored {
    /// Drive of the log.
    pub drive: usize,
    /// Stamp of the window's end, s.
    pub secs: f64,
    /// By channel, in the order of the channels: logarithm of the mean loss and mean of the residuals, in floor units; none
    /// where the channel was not recorded.
    pub channels: Vec<Option<[f64; 2]>>,
}

/// Noise of the sensors with which windows are measured, relative to those of the library's floor.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Sensors {
    /// By channel of the ego, then followers' speed and gap.
    pub noise: Vec<f64>,
    /// Standard deviation of the sampling instants, s.
    pub jitter_secs: f64,
}

/// The windows of healthy logs, each log scored by a baseline of the others.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Windows {
    /// Sensors that all are measured with.
    pub sensors: Sensors,
    /// The windows by log, in order of time.
    pub logs: Vec<Vec<Scored>>,
}

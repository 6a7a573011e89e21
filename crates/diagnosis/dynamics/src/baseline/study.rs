//! What one healthy log says by itself: estimates of every parameter, and the residuals that are left.

use super::features::FEATURES;
use super::spread::Estimate;

/// One residual of the ego.
#[derive(Debug, Clone, Copy)]
pub struct Row {
    /// Channel, by its place in `Channel::ALL`.
    pub channel: usize,
    /// Block within the window.
    pub block: usize,
    /// Place of its features.
    pub place: usize,
    /// Measured minus simulated, in floor units of the library.
    pub residual: f64,
}

/// What one log says.
#[derive(Debug, Clone)]
pub struct Study {
    /// Estimates of every parameter of both parts, in the order of their spaces; `None` where it has no usual spread.
    pub estimates: [Vec<Option<Estimate>>; 2],
    /// Features of every block of every window.
    pub features: Vec<[f64; FEATURES]>,
    /// Residuals of the ego.
    pub rows: Vec<Row>,
    /// Residuals of the followers: channel, block and value.
    pub followers: Vec<(usize, usize, f64)>,
}

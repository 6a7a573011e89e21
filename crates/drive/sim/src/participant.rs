//! Who takes part in traffic: how an agent moves, the ego as others see it.

use ds_space::{DVec2, PoseSe2};
use ds_world::Size;

/// How an agent moves now.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Motion {
    /// As logged.
    Replay,
    /// Along its path.
    Following {
        /// Distance of its centre along the path.
        along_m: f64,
        /// Its speed along the path.
        speed_mps: f64,
    },
    /// It left at the end of its path.
    Gone,
}

/// The ego as followers see it: its centre, its velocity in the world and its size.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Obstructing {
    pub(crate) centre: PoseSe2,
    pub(crate) velocity_mps: DVec2,
    pub(crate) size: Size,
}

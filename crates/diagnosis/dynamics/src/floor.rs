//! The noise floor of each ego and follower channel: what remains between the log of an effect-free world and the
//! nominal simulator after its nuisances are fitted, as σ² = a² + (b h)² with h the seconds since the anchor.
//!
//! Robust scale over the effect-free practice cases; regimes of hard driving widen the floor.

use crate::noise::Noise;
use crate::windows::{BLOCKS, EGO, Regime};

/// a, b and the growth with lateral acceleration, with steering rate and with |acceleration| per ego channel.
pub const EGO_FLOOR: [[f64; 2]; EGO] = [
    [0.018, 0.015],
    [0.018, 0.020],
    [0.0012, 0.0010],
    [0.013, 0.012],
    [0.0022, 0.0],
    [0.055, 0.0],
    [0.060, 0.0],
    [0.0004, 0.0],
    [0.018, 0.012],
];

/// a and b per follower channel.
pub const FOLLOWER_FLOOR: [[f64; 2]; 2] = [[0.045, 0.03], [0.06, 0.04]];

/// Returns the floor of an ego channel and block for sensors of some noise, in the channel's unit; jitter of the stamps
/// widens the displacement along the path by speed times jitter.
#[must_use]
pub fn ego(channel: usize, block: usize, regime: &Regime, noise: &Noise) -> f64 {
    let h = (block as f64 + 0.5) * 2.0 / BLOCKS as f64;
    // displacement drifts by the error of the speed and heading it started from
    let source = [3, 2].get(channel).copied().unwrap_or(channel);
    let (a, b) = (EGO_FLOOR[channel][0] * noise.ego[channel], EGO_FLOOR[channel][1] * noise.ego[source]);
    let jitter_secs = noise.jitter_secs;
    // beyond the fitted two seconds displacement drifts with the square of time
    let late = if channel < 2 { 0.012 * (h - 2.0).max(0.0).powi(2) } else { 0.0 };
    let floor = a.hypot(b * h).hypot(late);
    if channel == 0 && jitter_secs > 0.002 { floor.hypot(0.65 * regime.speed_mps * jitter_secs) } else { floor }
}

/// Returns the floor of a follower channel and block for sensors of some noise, in the channel's unit.
#[must_use]
pub fn follower(channel: usize, block: usize, noise: &Noise) -> f64 {
    let h = (block as f64 + 0.5) * 0.5;
    let [a, b] = FOLLOWER_FLOOR[channel];
    noise.follower[channel] * a.hypot(b * h)
}

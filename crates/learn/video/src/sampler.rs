//! The few-step schedule and the noise of a rollout.
//!
//! Nominal times u = 1, 1 − 1/S, … are warped by u' = s·u / (1 + (s − 1)·u); σ = u', t = 1000·σ. Noise is a function
//! of (draw key, camera, chunk, step), so that any worker can make or remake a chunk.

use ds_nn::Array;
use ds_space::{Digest, Draws};

/// Returns the noise level σ of each of the sampler's steps.
#[must_use]
pub fn sigmas(steps: usize, shift: f64) -> Vec<f32> {
    (0..steps).map(|step| shifted(1.0 - step as f64 / steps as f64, shift)).collect()
}

/// Returns the level of a nominal time, 0 to 1, after the time shift.
#[must_use]
pub fn shifted(nominal: f64, shift: f64) -> f32 {
    #[expect(clippy::cast_possible_truncation, reason = "levels are single precision")]
    let sigma = (shift * nominal / (1.0 + (shift - 1.0) * nominal)) as f32;
    sigma
}

/// Draws the noise that enters a step (from 1) of a chunk.
#[must_use]
pub fn noise(draw_key: &Digest, camera: &str, chunk: u32, step: usize, shape: &[usize]) -> Array {
    Array::normal(shape, &Draws::new(draw_key, &format!("video-noise/{camera}"), &[u64::from(chunk), step as u64]))
}

/// Returns (1 − σ)·clean + σ·noise.
#[must_use]
pub fn noised(clean: &Array, noise: &Array, sigma: f32) -> Array {
    let mix = |(clean, noise): (&f32, &f32)| (1.0 - sigma) * clean + sigma * noise;
    Array::new(clean.shape(), clean.values().iter().zip(noise.values()).map(mix).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(input: (usize, f64), expected: &[f32]) {
        let found = sigmas(input.0, input.1);
        let close = found.iter().zip(expected).all(|(a, b)| (a * 1000.0 - b).abs() < 0.01);
        assert!(found.len() == expected.len() && close, "{input:?}: {found:?}");
    }

    #[test]
    fn the_schedule_is_the_published_one() {
        check((4, 5.0), &[1000.0, 937.5, 833.33, 625.0]);
        check((4, 8.0), &[1000.0, 960.0, 888.89, 727.27]);
        check((2, 5.0), &[1000.0, 833.33]);
        check((4, 1.0), &[1000.0, 750.0, 500.0, 250.0]);
    }

    #[test]
    fn noise_of_level_zero_changes_nothing() {
        let clean = noise(&Digest::of(b"a"), "front", 3, 1, &[2, 5]);
        let other = noise(&Digest::of(b"b"), "front", 3, 1, &[2, 5]);
        assert_ne!(clean, other);
        assert_eq!(noised(&clean, &other, 0.0), clean);
        assert_eq!(noised(&clean, &other, 1.0), other);
    }
}

//! Changes a frame's colours, sharpness and noise, so that the policy also knows softer pictures of the same place.
//!
//! Works on values as the network sees them; every change is a function of the draws. Pixels never move.

use ds_nn::planner::{HEIGHT_PX, WIDTH_PX};
use ds_policy::camera::normalise_into;
use ds_space::Draws;

const ROW: usize = WIDTH_PX * 3;

/// Appends the changed frame.
#[expect(clippy::cast_possible_truncation, reason = "pixels are single precision")]
pub(super) fn augment_into(rgb: &[u8], draws: &Draws, pixels: &mut Vec<f32>) {
    let start = pixels.len();
    normalise_into(rgb, pixels);
    let frame = &mut pixels[start..];
    if draws.uniform(0) < 0.15 {
        return;
    }
    let softness = if draws.uniform(1) < 0.7 { draws.below(2, 4) } else { 0 };
    for pass in 0..softness {
        let share = draws.range(3 + pass, 0.1, 0.3) as f32;
        blur(frame, share);
    }
    if draws.uniform(8) < 0.25 {
        coarsen(frame);
    }
    let contrast = draws.range(10, 0.75, 1.25) as f32;
    let brightness = draws.range(11, -0.35, 0.35) as f32;
    let tint: [f32; 3] = std::array::from_fn(|c| draws.range(12 + c as u64, -0.15, 0.15) as f32);
    for pixel in frame.chunks_exact_mut(3) {
        pixel.iter_mut().zip(tint).for_each(|(value, tint)| *value = contrast * *value + brightness + tint);
    }
    if draws.uniform(16) < 0.5 {
        let strength = draws.range(17, 0.0, 0.3) as f32;
        noise(frame, &Draws::from_seed(draws.u64(18), "frame noise"), strength);
    }
}

/// Mixes each pixel with its four neighbours.
fn blur(frame: &mut [f32], share: f32) {
    let centre = 1.0 - 2.0 * share;
    for row in frame.chunks_exact_mut(ROW) {
        let mut before: [f32; 3] = [row[0], row[1], row[2]];
        for x in 0..WIDTH_PX {
            for c in 0..3 {
                let here = row[3 * x + c];
                let after = if x + 1 < WIDTH_PX { row[3 * x + 3 + c] } else { here };
                row[3 * x + c] = centre * here + share * (before[c] + after);
                before[c] = here;
            }
        }
    }
    let mut before = frame[..ROW].to_vec();
    for y in 0..HEIGHT_PX {
        let (head, tail) = frame.split_at_mut((y + 1) * ROW);
        let row = &mut head[y * ROW..];
        let here = row.to_vec();
        for (x, value) in row.iter_mut().enumerate() {
            let after = if y + 1 < HEIGHT_PX { tail[x] } else { here[x] };
            *value = centre * here[x] + share * (before[x] + after);
        }
        before = here;
    }
}

/// Replaces each 2×2 block by its mean.
fn coarsen(frame: &mut [f32]) {
    for pair in frame.chunks_exact_mut(2 * ROW) {
        let (top, bottom) = pair.split_at_mut(ROW);
        for (a, b) in top.chunks_exact_mut(6).zip(bottom.chunks_exact_mut(6)) {
            for c in 0..3 {
                let mean = 0.25 * (a[c] + a[c + 3] + b[c] + b[c + 3]);
                (a[c], a[c + 3], b[c], b[c + 3]) = (mean, mean, mean, mean);
            }
        }
    }
}

/// Adds near-normal noise: the sum of two uniform draws of 16 bits.
fn noise(frame: &mut [f32], draws: &Draws, strength: f32) {
    for (quad, index) in frame.chunks_mut(2).zip(0u64..) {
        let mut bits = draws.u64(index);
        for value in quad {
            let sum = (bits & 0xFFFF) as f32 + ((bits >> 16) & 0xFFFF) as f32;
            *value += strength * (sum * (1.0 / 65_535.0) - 1.0);
            bits >>= 32;
        }
    }
}

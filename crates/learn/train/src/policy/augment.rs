//! Changes a frame's colours, sharpness and noise, so that the policy also knows softer pictures of the same place.
//!
//! Works on values as the network sees them; every change is a function of the draws. Pixels never move.

use ds_graph::planner::{HEIGHT_PX, WIDTH_PX};
use ds_policy::camera::eye::normalise_into;
use ds_raster::RgbImage;
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
    match draws.uniform(8) {
        share if share < 0.15 => coarsen(frame),
        share if share < 0.5 => wash(frame, 2 + 2 * draws.below(9, 3) as usize, draws.range(20, 0.4, 1.0) as f32),
        _ => {}
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

/// Returns a frame at a quarter of its resolution; one of another size than the network's is returned as it is.
pub(super) fn softened(frame: &RgbImage) -> RgbImage {
    let mut values: Vec<f32> = frame.rgb().iter().map(|value| f32::from(*value)).collect();
    let mut softened = frame.clone();
    if values.len() == ROW * HEIGHT_PX {
        wash(&mut values, 4, 1.0);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "means of 8-bit values")]
        softened.rgb_mut().iter_mut().zip(&values).for_each(|(to, from)| *to = from.round() as u8);
    }
    softened
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

/// Mixes in a copy of a coarser resolution, smooth between the centres of its squares, as a small decoder would give.
fn wash(frame: &mut [f32], side: usize, share: f32) {
    let (wide, high) = (WIDTH_PX / side, HEIGHT_PX / side);
    let mut coarse = vec![0.0; wide * high * 3];
    for y in 0..high * side {
        for x in 0..wide * side {
            for c in 0..3 {
                coarse[(y / side * wide + x / side) * 3 + c] += frame[y * ROW + 3 * x + c] / (side * side) as f32;
            }
        }
    }
    let place = |at: usize, count: usize| {
        let at = ((at as f32 + 0.5) / side as f32 - 0.5).clamp(0.0, count as f32 - 1.0);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped just before")]
        let low = (at as usize).min(count.saturating_sub(2));
        (low, (low + 1).min(count - 1), at - low as f32)
    };
    let columns: Vec<_> = (0..WIDTH_PX).map(|x| place(x, wide)).collect();
    for y in 0..HEIGHT_PX {
        let (top, bottom, down) = place(y, high);
        for (x, (left, right, across)) in columns.iter().enumerate() {
            for c in 0..3 {
                let at = |row: usize, column: usize| coarse[(row * wide + column) * 3 + c];
                let upper = at(top, *left) + across * (at(top, *right) - at(top, *left));
                let lower = at(bottom, *left) + across * (at(bottom, *right) - at(bottom, *left));
                let value = &mut frame[y * ROW + 3 * x + c];
                *value += share * (upper + down * (lower - upper) - *value);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_of_one_colour_keeps_it_through_every_softening() {
        for side in [2, 4, 6] {
            let mut frame = vec![0.7; ROW * HEIGHT_PX];
            blur(&mut frame, 0.3);
            coarsen(&mut frame);
            wash(&mut frame, side, 0.8);
            assert!(frame.iter().all(|value| (value - 0.7).abs() < 1e-4), "side {side}");
        }
    }

    #[test]
    fn softening_keeps_things_in_their_place() {
        let mut frame = vec![0.0; ROW * HEIGHT_PX];
        let (x, y) = (81, 40);
        frame[y * ROW + 3 * x] = 1.0;
        blur(&mut frame, 0.25);
        wash(&mut frame, 4, 1.0);
        let centre = |axis: fn(usize) -> usize| {
            let (mut sum, mut weight) = (0.0, 0.0);
            for (index, value) in frame.iter().enumerate().step_by(3) {
                sum += value * axis(index / 3) as f32;
                weight += value;
            }
            sum / weight
        };
        assert!((centre(|pixel| pixel % WIDTH_PX) - x as f32).abs() < 1.6);
        assert!((centre(|pixel| pixel / WIDTH_PX) - y as f32).abs() < 1.6);
    }

    #[test]
    fn the_same_draws_change_a_frame_the_same_way_and_others_otherwise() {
        let rgb: Vec<u8> = (0..ROW * HEIGHT_PX).map(|i| (i * 7 % 251) as u8).collect();
        let changed = |seed: u64| {
            let mut pixels = Vec::new();
            augment_into(&rgb, &Draws::from_seed(seed, "augment test"), &mut pixels);
            pixels
        };
        assert_eq!(changed(1), changed(1));
        assert!((2..12).any(|seed| changed(seed) != changed(1)));
        assert!((0..12).all(|seed| changed(seed).len() == rgb.len() && changed(seed).iter().all(|v| v.is_finite())));
    }
}

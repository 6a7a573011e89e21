//! Frames made a little less sharp: blurred, washed out, changed in light and made noisy, as drawn.
//!
//! Generated frames are softer than rendered ones; networks that are to read both see both.

use ds_raster::RgbImage;
use ds_space::Draws;

/// Returns the frame's values, blurred, washed out, changed in light and made noisy as drawn.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "pixels are single precision")]
pub fn softened(frame: &RgbImage, draws: &Draws) -> Vec<f32> {
    let mut values: Vec<f32> = frame.values().collect();
    if draws.uniform(0) < 0.2 {
        return values;
    }
    let size = (frame.width_px() as usize, frame.height_px() as usize);
    for pass in 0..draws.below(1, 4) {
        blur(&mut values, size, draws.range(2 + pass, 0.1, 0.3) as f32);
    }
    if draws.uniform(8) < 0.35 {
        wash(&mut values, size, 2 << draws.below(9, 2), draws.range(10, 0.3, 1.0) as f32);
    }
    let (contrast, brightness) = (draws.range(11, 0.8, 1.15) as f32, draws.range(12, -0.12, 0.12) as f32);
    let strength = if draws.uniform(13) < 0.5 { draws.range(14, 0.0, 0.15) } else { 0.0 };
    let noise = Draws::from_seed(draws.u64(15), "frame noise");
    for (index, value) in (0..).zip(&mut values) {
        *value = contrast * *value + brightness;
        if strength > 0.0 {
            *value += (strength * (2.0 * noise.uniform(index) - 1.0)) as f32;
        }
    }
    values
}

/// Mixes each pixel with its four neighbours, along rows, then along columns.
fn blur(values: &mut [f32], (width, height): (usize, usize), share: f32) {
    let mixed = |before: f32, here: f32, after: f32| (1.0 - 2.0 * share) * here + share * (before + after);
    let mut along = |count: usize, step: usize, start: usize| {
        let mut before = values[start];
        for k in 0..count {
            let here = values[start + k * step];
            let after = if k + 1 < count { values[start + (k + 1) * step] } else { here };
            values[start + k * step] = mixed(before, here, after);
            before = here;
        }
    };
    for y in 0..height {
        (0..3).for_each(|colour| along(width, 3, y * width * 3 + colour));
    }
    for column in 0..width * 3 {
        along(height, width * 3, column);
    }
}

/// Mixes in a copy of a coarser resolution, smooth between the centres of its squares.
fn wash(values: &mut [f32], (width, height): (usize, usize), side: usize, share: f32) {
    let (wide, high) = (width / side, height / side);
    let mut coarse = vec![0.0; wide * high * 3];
    for (index, value) in values.iter().enumerate() {
        let (x, y, colour) = (index / 3 % width, index / 3 / width, index % 3);
        if y / side < high && x / side < wide {
            coarse[(y / side * wide + x / side) * 3 + colour] += value / (side * side) as f32;
        }
    }
    let place = |at: usize, count: usize| {
        let at = ((at as f32 + 0.5) / side as f32 - 0.5).clamp(0.0, count as f32 - 1.0);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped just before")]
        let low = (at as usize).min(count - 1);
        (low, (low + 1).min(count - 1), at - low as f32)
    };
    for (index, value) in values.iter_mut().enumerate() {
        let ((left, right, across), (top, bottom, down)) =
            (place(index / 3 % width, wide), place(index / 3 / width, high));
        let at = |y: usize, x: usize| coarse[(y * wide + x) * 3 + index % 3];
        let upper = at(top, left) + across * (at(top, right) - at(top, left));
        let lower = at(bottom, left) + across * (at(bottom, right) - at(bottom, left));
        *value += share * (upper + down * (lower - upper) - *value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blurring_and_washing_keep_flat_colour_and_mean() {
        let size = (16, 8);
        let mut flat = vec![0.25; 16 * 8 * 3];
        blur(&mut flat, size, 0.2);
        wash(&mut flat, size, 4, 0.7);
        assert!(flat.iter().all(|value| (value - 0.25).abs() < 1e-5));
        let mut dot = vec![0.0; 16 * 8 * 3];
        dot[(4 * 16 + 8) * 3] = 1.0;
        blur(&mut dot, size, 0.2);
        assert!((dot.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        assert!((dot[(4 * 16 + 8) * 3] - 0.36).abs() < 1e-5, "0.6 of a row, then 0.6 of a column");
        assert!((dot[(4 * 16 + 9) * 3] - 0.12).abs() < 1e-5);
    }

    #[test]
    fn softening_is_a_function_of_its_draws() {
        let image =
            RgbImage::new(16, 8, (0..16 * 8 * 3).map(|i| (i * 37 % 256) as u8).collect()).expect("the size fits");
        let soft = |seed| softened(&image, &Draws::from_seed(seed, "test"));
        assert_eq!(soft(1), soft(1));
        assert!((2..6).any(|seed| soft(seed) != soft(1)));
        assert!((0..20).all(|seed| soft(seed).iter().all(|value| value.abs() < 1.6)));
    }
}

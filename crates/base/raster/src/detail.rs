//! Detail of painted frames: specks are taken out before a frame is carried on, and what is shown is brought out a little.
//!
//! A painter that sees its own last frame adds to what it saw there, so that single pixels of black and white side by side grow
//! from chunk to chunk where things are a few pixels wide.

use crate::alike::Alike;
use crate::image::RgbImage;

/// Pixels to each side of one that it is compared with.
const REACH: usize = 2;
/// A value may differ by so much from the mean around it, of 255.
const MOST: i32 = 45;

/// Returns the frame with each value that stands out from a direct neighbour brought within 45 of 255 of the mean of the 5×5 around
/// that show the same in the layout.
///
/// # Panics
///
/// Panics if the two differ in size.
#[must_use]
pub fn calmed(frame: &RgbImage, layout: &RgbImage) -> RgbImage {
    let seen = frame.rgb().as_chunks::<3>().0;
    let alike = Alike::new(frame, layout);
    let (width, height) = (alike.width, alike.height);
    let mut calmed = frame.clone();
    for (at, pixel) in calmed.rgb_mut().as_chunks_mut::<3>().0.iter_mut().enumerate() {
        let (x, y) = (at % width, at / width);
        let beside = [(x > 0).then(|| at - 1), (x + 1 < width).then_some(at + 1)];
        let above = [(y > 0).then(|| at - width), (y + 1 < height).then_some(at + width)];
        let apart = |near: &usize| (0..3).any(|c| seen[*near][c].abs_diff(seen[at][c]) > MOST as u8);
        if !beside.into_iter().chain(above).flatten().any(|near| apart(&near)) {
            continue;
        }
        let (mut sum, mut count) = ([0; 3], 0);
        for near in alike.around(at, REACH) {
            (0..3).for_each(|c| sum[c] += i32::from(seen[near][c]));
            count += 1;
        }
        for (value, sum) in pixel.iter_mut().zip(sum) {
            let mean = sum / count;
            *value = i32::from(*value).clamp(mean - MOST, mean + MOST) as u8;
        }
    }
    calmed
}

/// Returns the frame with what each pixel differs by from the 3×3 around it (binomial) made larger by a share of it.
#[must_use]
pub fn sharpened(frame: &RgbImage, share: f32) -> RgbImage {
    let (width, height) = (frame.width_px() as usize, frame.height_px() as usize);
    let row = 3 * width;
    let mut across = vec![0.0f32; frame.rgb().len()];
    for (blurred, seen) in across.chunks_exact_mut(row).zip(frame.rgb().chunks_exact(row)) {
        for (at, blurred) in blurred.iter_mut().enumerate() {
            let [left, right] = [if at < 3 { at } else { at - 3 }, if at + 3 < row { at + 3 } else { at }];
            *blurred = 0.25 * f32::from(seen[left]) + 0.5 * f32::from(seen[at]) + 0.25 * f32::from(seen[right]);
        }
    }
    let mut sharpened = frame.clone();
    for (at, value) in sharpened.rgb_mut().iter_mut().enumerate() {
        let [above, below] =
            [if at < row { at } else { at - row }, if at + row < row * height { at + row } else { at }];
        let around = 0.25 * across[above] + 0.5 * across[at] + 0.25 * across[below];
        let seen = f32::from(*value);
        *value = (seen + share * (seen - around)).round() as u8;
    }
    sharpened
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIDE: u32 = 12;

    fn drawn(colour: impl Fn(u32, u32) -> u8) -> RgbImage {
        let mut image = RgbImage::filled(SIDE, SIDE, [0; 3]);
        for (at, pixel) in (0u32..).zip(image.rgb_mut().chunks_exact_mut(3)) {
            pixel.fill(colour(at % SIDE, at / SIDE));
        }
        image
    }

    #[test]
    fn chequers_are_brought_near_their_mean() {
        let calm = calmed(&drawn(|x, y| if (x + y) % 2 == 0 { 0 } else { 240 }), &drawn(|_, _| 7));
        // At the corners of the picture five of nine are of one kind.
        assert!(calm.rgb().iter().all(|value| (60..=180).contains(value)), "{:?}", calm.rgb());
    }

    #[test]
    fn what_the_layout_tells_apart_keeps_its_edge() {
        let line = |x: u32, _| if x == 5 { 250 } else { 60 };
        assert_eq!(calmed(&drawn(line), &drawn(|x, _| u8::from(x == 5))), drawn(line));
    }

    #[test]
    fn what_differs_no_more_than_windows_do_is_left_alone() {
        let windows = drawn(|x, y| if x % 3 == 0 && y % 3 == 0 { 90 } else { 130 });
        assert_eq!(calmed(&windows, &drawn(|_, _| 7)), windows);
    }

    #[test]
    fn sharpening_makes_an_edge_steeper_and_leaves_what_is_even() {
        let edge = sharpened(&drawn(|x, _| if x < 6 { 100 } else { 140 }), 0.5);
        let row: Vec<u8> = edge.rgb()[..3 * SIDE as usize].iter().step_by(3).copied().collect();
        assert_eq!(row, [100, 100, 100, 100, 100, 95, 145, 140, 140, 140, 140, 140]);
    }
}

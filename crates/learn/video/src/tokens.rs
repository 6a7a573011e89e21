//! Between images and the arrays of the networks: stacked and space-to-depth frames, latent tokens.
//!
//! A latent step folds `stride_t` frames: each 8×8 block of all of them becomes
//! one latent pixel with values ordered (frame, row, column, colour). Tokens are 2×2 latent pixels, row-major.

use ds_nn::Array;
use ds_nn::tiny_ae::BLOCK_PX;
use ds_raster::{RgbImage, value};

/// Folds the frames of one latent step into [h, w, frames·192] values.
#[must_use]
pub fn fold(frames: &[&RgbImage]) -> Vec<f32> {
    let (width, height) = (frames[0].width_px() as usize, frames[0].height_px() as usize);
    let (h, w) = (height / BLOCK_PX, width / BLOCK_PX);
    let mut values = Vec::with_capacity(frames.len() * width * height * 3);
    for y in 0..h {
        for x in 0..w {
            for frame in frames {
                for row in 0..BLOCK_PX {
                    let at = ((y * BLOCK_PX + row) * width + x * BLOCK_PX) * 3;
                    let pixels = &frame.rgb()[at..at + BLOCK_PX * 3];
                    values.extend(pixels.iter().map(|byte| value(*byte)));
                }
            }
        }
    }
    values
}

/// Reorders latent pixels [h, w, c] into tokens [h/2 · w/2, 4, c].
#[must_use]
pub fn to_tokens(values: &[f32], h: usize, w: usize) -> Vec<f32> {
    let c = values.len() / (h * w);
    let mut tokens = Vec::with_capacity(values.len());
    for (y, x) in (0..h / 2).flat_map(|y| (0..w / 2).map(move |x| (y, x))) {
        for (dy, dx) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let at = ((2 * y + dy) * w + 2 * x + dx) * c;
            tokens.extend_from_slice(&values[at..at + c]);
        }
    }
    tokens
}

/// Reorders tokens [h/2 · w/2, 4, c] into latent pixels [h, w, c].
#[must_use]
pub fn from_tokens(tokens: &[f32], h: usize, w: usize) -> Vec<f32> {
    let c = tokens.len() / (h * w);
    let mut values = vec![0.0; tokens.len()];
    for (token, chunk) in tokens.chunks_exact(4 * c).enumerate() {
        let (y, x) = (token / (w / 2), token % (w / 2));
        for (pixel, value) in chunk.chunks_exact(c).enumerate() {
            let at = ((2 * y + pixel / 2) * w + 2 * x + pixel % 2) * c;
            values[at..at + c].copy_from_slice(value);
        }
    }
    values
}

/// Reorders latents [frames, h, w, c] into tokens [frames, h/2 · w/2, 4, c].
///
/// # Panics
/// If the array has not four axes.
#[must_use]
pub fn latents_to_tokens(latents: &Array) -> Array {
    let [frames, h, w, c]: [usize; 4] = latents.shape().try_into().expect("latents have four axes");
    let tokens = latents.values().chunks_exact((h * w * c).max(1)).flat_map(|frame| to_tokens(frame, h, w));
    Array::new(&[frames, h * w / 4, 4, c], tokens.collect())
}

/// Reorders tokens [frames, h/2 · w/2, 4, c] into latents [frames, h, w, c].
///
/// # Panics
/// If the array has not four axes.
#[must_use]
pub fn tokens_to_latents(tokens: &Array, h: usize, w: usize) -> Array {
    let [frames, n, pixels, c]: [usize; 4] = tokens.shape().try_into().expect("tokens have four axes");
    let latents = tokens.values().chunks_exact((n * pixels * c).max(1)).flat_map(|frame| from_tokens(frame, h, w));
    Array::new(&[frames, h, w, c], latents.collect())
}

/// Stacks images to [frames, height, width, 3] values, −1 to 1.
#[must_use]
pub fn stacked(frames: &[&RgbImage]) -> Array {
    let (width, height) = (frames[0].width_px() as usize, frames[0].height_px() as usize);
    let values = frames.iter().flat_map(|frame| frame.values());
    Array::new(&[frames.len(), height, width, 3], values.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(width: u32, height: u32) -> RgbImage {
        let rgb = (0..width * height * 3).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        RgbImage::new(width, height, rgb).expect("the size fits")
    }

    #[test]
    fn tokens_and_latent_pixels_are_inverse() {
        let values: Vec<f32> = (0..4 * 6 * 3).map(|i| i as f32).collect();
        let tokens = to_tokens(&values, 4, 6);
        assert_eq!(from_tokens(&tokens, 4, 6), values);
        let latents = Array::new(&[2, 4, 6, 3], values.repeat(2));
        assert_eq!(tokens_to_latents(&latents_to_tokens(&latents), 4, 6), latents);
        assert_eq!(tokens[3..6], values[3..6], "the second pixel of a token lies to the right");
        assert_eq!(tokens[6..9], values[18..21], "the third lies below the first");
    }

    #[test]
    fn folding_keeps_every_value_in_its_block() {
        let (a, b) = (picture(16, 8), RgbImage::filled(16, 8, [0, 255, 0]));
        let folded = fold(&[&a, &b]);
        assert_eq!(folded.len(), 2 * 16 * 8 * 3);
        // Latent pixel 1, frame 0, row 2, column 3, green.
        assert_eq!(folded[2 * 192 + (2 * 8 + 3) * 3 + 1], value(a.pixel(8 + 3, 2)[1]));
        assert_eq!(folded[192..195], [-1.0, 1.0, -1.0]);
    }
}

//! Statistics of a frame's colours: the first things to drift in a long rollout.
//!
//! Luma is 0.299 R + 0.587 G + 0.114 B, chroma its differences from blue and red (BT.601), all 0 to 255. High-frequency
//! energy is the mean absolute difference of luma from the mean of its four neighbours.

use ds_nn::tiny_ae::BLOCK_PX;
use ds_raster::RgbImage;
use serde::{Deserialize, Serialize};

/// The statistics.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Colour {
    /// Mean luma.
    pub luma: f64,
    /// Standard deviation of luma.
    pub contrast: f64,
    /// Mean of the blue difference.
    pub blue: f64,
    /// Mean of the red difference.
    pub red: f64,
    /// High-frequency energy.
    pub detail: f64,
}

impl Colour {
    /// Names of the statistics, in the order of [`Self::values`].
    pub const NAMES: [&'static str; 5] = ["luma", "contrast", "blue", "red", "detail"];

    /// Measures a frame.
    #[must_use]
    pub fn of(frame: &RgbImage) -> Self {
        let luma = luma(frame);
        let count = luma.len().max(1) as f64;
        let mean = luma.iter().sum::<f64>() / count;
        let variance = luma.iter().map(|y| (y - mean).powi(2)).sum::<f64>() / count;
        let difference = |colour: usize, scale: f64| {
            let pairs = frame.rgb().chunks_exact(3).zip(&luma);
            pairs.map(|(p, y)| scale * (f64::from(p[colour]) - y)).sum::<f64>() / count
        };
        let (width, height) = (frame.width_px() as usize, frame.height_px() as usize);
        let (mut detail, mut inner) = (0.0, 0.0);
        for y in 1..height.saturating_sub(1) {
            for x in 1..width.saturating_sub(1) {
                let k = y * width + x;
                let around = luma[k - 1] + luma[k + 1] + luma[k - width] + luma[k + width];
                detail += (luma[k] - 0.25 * around).abs();
                inner += 1.0;
            }
        }
        Self {
            luma: mean,
            contrast: variance.sqrt(),
            blue: difference(2, 0.564),
            red: difference(0, 0.713),
            detail: detail / f64::max(inner, 1.0),
        }
    }

    /// Returns the statistics in the order of [`Self::NAMES`].
    #[must_use]
    pub fn values(&self) -> [f64; 5] {
        [self.luma, self.contrast, self.blue, self.red, self.detail]
    }
}

/// Mean absolute steps of luma between neighbouring pixels of a row or column, 0 to 255.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Steps {
    /// Across the borders of blocks of 8×8 pixels.
    pub across: f64,
    /// Inside them.
    pub inside: f64,
}

impl Steps {
    /// Measures a frame.
    #[must_use]
    pub fn of(frame: &RgbImage) -> Self {
        let luma = luma(frame);
        let width = frame.width_px() as usize;
        let (mut sums, mut counts) = ([0.0; 2], [0.0; 2]);
        for (at, value) in luma.iter().enumerate() {
            let (x, y) = (at % width, at / width);
            for (place, back) in [(x, 1), (y, width)] {
                if place > 0 {
                    let kind = usize::from(!place.is_multiple_of(BLOCK_PX));
                    sums[kind] += (value - luma[at - back]).abs();
                    counts[kind] += 1.0;
                }
            }
        }
        let mean = |kind: usize| sums[kind] / f64::max(counts[kind], 1.0);
        Self { across: mean(0), inside: mean(1) }
    }
}

/// Returns the luma of every pixel.
/// Returns the luma of each pixel of a frame, 0 to 255, rows top to bottom.
#[must_use]
pub fn luma(frame: &RgbImage) -> Vec<f64> {
    let pixels = frame.rgb().chunks_exact(3);
    pixels.map(|p| 0.299 * f64::from(p[0]) + 0.587 * f64::from(p[1]) + 0.114 * f64::from(p[2])).collect()
}

/// Returns the peak signal-to-noise ratio of a frame, in decibels; at most 99.
#[must_use]
pub fn psnr_db(expected: &RgbImage, found: &RgbImage) -> f64 {
    let pairs = expected.rgb().iter().zip(found.rgb());
    let square: f64 = pairs.map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
    let mse = square / expected.rgb().len().max(1) as f64;
    (10.0 * (255.0f64.powi(2) / mse.max(1e-9)).log10()).min(99.0)
}

/// Returns the mean absolute difference of two frames, 0 to 255.
#[must_use]
pub fn difference(a: &RgbImage, b: &RgbImage) -> f64 {
    let sum: u64 = a.rgb().iter().zip(b.rgb()).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    sum as f64 / a.rgb().len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flat_grey_has_no_contrast_chroma_or_detail() {
        let grey = Colour::of(&RgbImage::filled(8, 6, [100; 3]));
        assert!((grey.luma - 100.0).abs() < 1e-9);
        assert!([grey.contrast, grey.blue, grey.red, grey.detail].iter().all(|value| value.abs() < 1e-9), "{grey:?}");
        let red = Colour::of(&RgbImage::filled(8, 6, [200, 0, 0]));
        assert!((red.luma - 59.8).abs() < 1e-9 && (red.red - 0.713 * 140.2).abs() < 1e-9 && red.blue < 0.0, "{red:?}");
    }

    #[test]
    fn a_checkerboard_is_all_detail() {
        let mut board = RgbImage::filled(8, 6, [0; 3]);
        for y in 0..6 {
            for x in (y % 2..8).step_by(2) {
                board.set_pixel(x, y, [255; 3]);
            }
        }
        let colour = Colour::of(&board);
        assert!((colour.detail - 255.0).abs() < 1e-9 && (colour.contrast - 127.5).abs() < 1e-9, "{colour:?}");
    }

    #[test]
    fn steps_at_borders_of_blocks_are_told_from_those_inside() {
        // Blocks of grey that rise by 20 from left to right, on a slope of 2 a pixel.
        let mut blocks = RgbImage::filled(24, 16, [0; 3]);
        for y in 0..16 {
            for x in 0..24u32 {
                blocks.set_pixel(x, y, [u8::try_from(2 * x + 20 * (x / 8)).expect("below 256"); 3]);
            }
        }
        let steps = Steps::of(&blocks);
        // Across: 2 columns of 16 rows by 22, one row of 24 columns by 0; inside: 21 columns of 16 by 2, 14 rows of 24.
        assert!((steps.across - 32.0 * 22.0 / 56.0).abs() < 1e-9, "{steps:?}");
        assert!((steps.inside - 336.0 * 2.0 / 672.0).abs() < 1e-9, "{steps:?}");
        assert_eq!(Steps::of(&RgbImage::filled(24, 16, [9; 3])), Steps::default());
    }

    #[test]
    fn differences_worked_out_by_hand() {
        let (a, b) = (RgbImage::filled(4, 4, [10, 20, 30]), RgbImage::filled(4, 4, [20, 20, 30]));
        assert!((difference(&a, &b) - 10.0 / 3.0).abs() < 1e-12);
        assert!((psnr_db(&a, &b) - 10.0 * (255.0f64.powi(2) / (100.0 / 3.0)).log10()).abs() < 1e-9);
        assert_eq!(psnr_db(&a, &a), 99.0);
    }
}

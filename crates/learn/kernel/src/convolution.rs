//! The 3×3 convolution as a product without unfolding: a row's pixels are rows of a matrix that overlap in the image.
//!
//! Three neighbours of one image row lie together in memory, so each of the three rows above, beside and below gives
//! one run of 3·channels values per pixel. Several images that stand for concatenated channels give one run each.

use super::arch::Arch;
use super::image::Image;
use super::panels::Packed;
use super::product::{Finish, Source, Target, product};

/// Most images side by side.
pub(crate) const IMAGES: usize = 2;

/// A convolution's weights in panels.
pub(crate) struct Convolution {
    packed: Packed,
    inputs: Vec<usize>,
}

impl Convolution {
    /// Packs a weight [outputs, 3, 3, inputs] whose inputs come from images of these channels.
    pub(crate) fn new(weight: &[f32], bias: &[f32], inputs: &[usize]) -> Self {
        assert!(inputs.len() <= IMAGES, "no layer joins more images");
        let total: usize = inputs.iter().sum();
        // Depth runs over (row, image, column, channel).
        let mut order = Vec::with_capacity(9 * total);
        for dy in 0..3 {
            let mut before = 0;
            for channels in inputs {
                for dx in 0..3 {
                    order.extend((0..*channels).map(|channel| (dy * 3 + dx) * total + before + channel));
                }
                before += channels;
            }
        }
        let value = |k: usize, column: usize| weight[column * 9 * total + order[k]];
        Self { packed: Packed::new(9 * total, bias.len(), Some(bias), value), inputs: inputs.to_vec() }
    }

    /// Returns the output channels.
    pub(crate) fn outputs(&self) -> usize {
        self.packed.columns
    }

    /// Computes one row of pixels; `images` are frames of `h`×`w` pixels with their border.
    pub(crate) fn row(
        &self,
        arch: Arch,
        images: &[&[f32]],
        y: usize,
        w: usize,
        target: Target<'_>,
        finish: Finish<'_>,
    ) {
        let nothing = Source { data: &[], offset: 0, stride: 0, depth: 0 };
        let mut sources = [nothing; 3 * IMAGES];
        for dy in 0..3 {
            for (index, (image, c)) in images.iter().zip(&self.inputs).enumerate() {
                let offset = (y + dy) * (w + 2) * c;
                sources[dy * images.len() + index] = Source { data: image, offset, stride: *c, depth: 3 * c };
            }
        }
        product(arch, w, &sources[..3 * images.len()], &self.packed, target, finish);
    }

    /// Computes all frames of an image from frames of others: `inputs` tells the images of a frame, `finish` what
    /// becomes of a row.
    pub(crate) fn apply<'a>(
        &self,
        arch: Arch,
        inputs: impl Fn(usize) -> [&'a [f32]; IMAGES] + Sync,
        out: &mut Image,
        finish: impl Fn(usize, usize) -> Finish<'a> + Sync,
    ) {
        let (w, c) = (out.w, out.c);
        out.each_row(|frame, y, row| {
            let images = inputs(frame);
            let target = Target { data: row, offset: c, stride: c };
            self.row(arch, &images[..self.inputs.len()], y, w, target, finish(frame, y));
        });
    }
}

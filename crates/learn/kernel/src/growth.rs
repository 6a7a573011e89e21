//! A linear layer whose outputs unfold into frames, rows and columns: an image grows twofold in space, and in time where asked for; and
//! the way back in space.
//!
//! Each output row is written as two products, one per column parity, so that nothing is shuffled afterwards.

use super::arch::Arch;
use super::image::Image;
use super::network::Named;
use super::panels::Packed;
use super::product::{Finish, Source, Target, product};

/// Per frame, row and column of the grown pixel one matrix.
pub(crate) struct Growth {
    parts: Vec<Packed>,
}

impl Growth {
    /// Packs the layer of a name, from pixels of `depth` channels to pixels of `columns`.
    pub(crate) fn new(named: &Named<'_>, name: &str, depth: usize, columns: usize) -> Self {
        let (weight, bias) = (named.values(&format!("{name}.weight")), named.values(&format!("{name}.bias")));
        let parts = weight.chunks_exact(columns * depth).zip(bias.chunks_exact(columns));
        Self { parts: parts.map(|(weight, bias)| Packed::linear(weight, Some(bias), depth)).collect() }
    }

    /// Writes the grown image, `frames` for each frame.
    pub(crate) fn apply(&self, arch: Arch, frames: usize, x: &Image, out: &mut Image) {
        out.reset([x.frames * frames, 2 * x.h, 2 * x.w, self.parts[0].columns]);
        let c = out.c;
        out.each_row(|frame, y, row| {
            for dx in 0..2 {
                let packed = &self.parts[(frame % frames * 2 + y % 2) * 2 + dx];
                let target = Target { data: row, offset: c * (1 + dx), stride: 2 * c };
                product(arch, x.w, &[x.row(frame / frames, y / 2)], packed, target, Finish::Relu);
            }
        });
    }
}

/// Writes an image of which each pixel is a linear layer of `side` by `side` (row, column, channel) of another's, 1 or 2.
pub(crate) fn folded(arch: Arch, layer: &Packed, side: usize, x: &Image, out: &mut Image) {
    out.reset([x.frames, x.h / side, x.w / side, layer.columns]);
    let (c, w) = (out.c, out.w);
    out.each_row(|frame, y, row| {
        let line = |dy: usize| {
            let pixels = x.row(frame, y * side + dy.min(side - 1));
            Source { stride: side * pixels.stride, depth: side * pixels.depth, ..pixels }
        };
        let target = Target { data: row, offset: c, stride: c };
        product(arch, w, &[line(0), line(1)][..side], layer, target, Finish::Relu);
    });
}

//! Keys and values of chunks as the cache keeps them, and the window that a chunk reads: rotated and packed.

use std::sync::Arc;

use ds_nn::array::digest_values;
use ds_nn::body::{Cached, FrameKv, Handle};
use ds_space::DigestWriter;
use rayon::prelude::*;

use super::Buffer;
use super::arch::Arch;
use super::attention::Keys;
use super::buffer::{Pool, Pooled};
use super::rotary::{Grid, Rotary};

/// Keys (un-rotated) and values of one chunk, as its blocks of rows left them: per layer keys, then values.
pub(crate) struct Captured {
    pub(crate) blocks: Vec<Pooled<Buffer>>,
    pub(crate) layers: usize,
    pub(crate) dim: usize,
    pub(crate) frames: usize,
}

impl Captured {
    /// Returns keys and values of a layer in a block.
    fn layer(&self, block: usize, layer: usize) -> (&[f32], &[f32]) {
        let buffer = &self.blocks[block];
        let part = buffer.len() / self.layers;
        buffer[layer * part..(layer + 1) * part].split_at(part / 2)
    }

    fn rows(&self) -> usize {
        self.blocks.iter().map(|block| block.len()).sum::<usize>() / (2 * self.layers * self.dim)
    }
}

impl Cached for Captured {
    fn frames(&self) -> usize {
        self.frames
    }

    /// Adds all keys and values to a digest, layer by layer in the order of rows.
    fn digest_into(&self, writer: &mut DigestWriter) {
        writer.u64(self.layers as u64).u64(self.rows() as u64).u64(self.dim as u64);
        for layer in 0..self.layers {
            (0..self.blocks.len()).for_each(|block| digest_values(writer, self.layer(block, layer).0));
            (0..self.blocks.len()).for_each(|block| digest_values(writer, self.layer(block, layer).1));
        }
    }

    fn frame(self: Arc<Self>, index: usize) -> FrameKv {
        FrameKv(Handle::new(FrameRows { captured: self, frame: index }))
    }
}

/// One frame of a chunk.
#[derive(Clone)]
pub(crate) struct FrameRows {
    captured: Arc<Captured>,
    frame: usize,
}

impl FrameRows {
    fn rows(&self) -> usize {
        self.captured.rows() / self.captured.frames
    }

    /// Hands out the frame's keys and values of a layer in runs of rows: the first row of the run within the frame,
    /// keys, values.
    fn runs(&self, layer: usize, mut each: impl FnMut(usize, &[f32], &[f32])) {
        let (dim, rows) = (self.captured.dim, self.rows());
        let (begin, end) = (self.frame * rows, (self.frame + 1) * rows);
        let mut first = 0;
        for block in 0..self.captured.blocks.len() {
            let (keys, values) = self.captured.layer(block, layer);
            let last = first + keys.len() / dim;
            let (from, to) = (begin.max(first), end.min(last));
            if from < to {
                let range = (from - first) * dim..(to - first) * dim;
                each(from - begin, &keys[range.clone()], &values[range]);
            }
            first = last;
        }
    }
}

/// The cached keys and values that a chunk sees, per layer, and the rotation of the chunk itself.
#[derive(Default)]
pub(crate) struct Sight {
    layers: Vec<SightLayer>,
    pub(crate) current: Rotary,
    cached: Rotary,
    empty: bool,
}

#[derive(Default)]
struct SightLayer {
    keys: Keys,
    rotated: Buffer,
}

impl Sight {
    /// Returns a layer's cached keys, if there are any.
    pub(crate) fn layer(&self, layer: usize) -> Option<&Keys> {
        (!self.empty).then(|| &self.layers[layer].keys)
    }

    /// Reads frames at their positions.
    pub(crate) fn read(
        pool: &Arc<Pool<Self>>,
        grid: &Grid,
        layers: usize,
        frames: &[(FrameRows, usize)],
        current: &[usize],
    ) -> Pooled<Self> {
        let mut sight = pool.take(Self::default);
        grid.fill(current, &mut sight.current);
        sight.empty = frames.is_empty();
        let Some((first, _)) = frames.first() else { return sight };
        let positions: Vec<usize> = frames.iter().map(|(_, position)| *position).collect();
        grid.fill(&positions, &mut sight.cached);
        sight.layers.resize_with(layers, SightLayer::default);
        let (rows, dim, head_dim) = (first.rows(), first.captured.dim, grid.head_dim());
        let Sight { layers, cached, .. } = &mut *sight;
        let cached: &Rotary = cached;
        layers.par_iter_mut().enumerate().with_max_len(1).for_each(|(layer, sight)| {
            sight.keys.reset(frames.len() * rows, dim / head_dim, head_dim);
            for (index, (frame, _)) in frames.iter().enumerate() {
                frame.runs(layer, |row, keys, values| {
                    sight.rotated.resize(keys.len());
                    sight.rotated.copy_from_slice(keys);
                    let row = index * rows + row;
                    cached.apply(Arch::new(), &mut sight.rotated, [0, dim, dim], row);
                    sight.keys.fill(row, &sight.rotated, values, dim, head_dim);
                });
            }
        });
        sight
    }
}

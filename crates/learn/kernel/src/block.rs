//! A block of rows on its way through the transformer: what one thread works on between two waits.
//!
//! Rows of different blocks meet in self-attention alone. A layer is therefore cut in two: `project` makes queries,
//! keys and values; `conclude` does all that follows. Both belong to one visit of the block: conclude a layer, project
//! the next.

use super::Buffer;
use super::arch::Arch;
use super::attention::{Keys, Seen, Tiles, attend};
use super::buffer::Pooled;
use super::norm::{After, layer_norm, rms_norm};
use super::panels::Packed;
use super::product::{Finish, Source, Table, Target, product};
use super::rotary::Rotary;

/// Weights of attention; the norm of queries carries the scale of scores.
pub(crate) struct Attention {
    /// Queries, keys and values in one, or queries alone.
    pub(crate) project: Packed,
    pub(crate) out: Packed,
    pub(crate) norm_q: Buffer,
    pub(crate) norm_k: Buffer,
}

/// Weights of attention to the context.
pub(crate) struct Cross {
    pub(crate) norm: [Buffer; 2],
    pub(crate) attention: Attention,
    pub(crate) keys: Packed,
    pub(crate) values: Packed,
}

/// Weights of one layer.
pub(crate) struct Layer {
    pub(crate) modulation: Buffer,
    pub(crate) attention: Attention,
    pub(crate) cross: Option<Cross>,
    pub(crate) ffn: [Packed; 2],
}

/// Modulation of all layers: per layer and time six rows, then per time the two rows of the head.
#[derive(Default)]
pub(crate) struct Modulation {
    pub(crate) layers: Buffer,
    pub(crate) head: Buffer,
    pub(crate) times: usize,
    pub(crate) dim: usize,
}

impl Modulation {
    fn row<'a>(&'a self, layer: usize, row: usize, index: &'a [u32]) -> Table<'a> {
        let layer_size = self.times * 6 * self.dim;
        Table { data: &self.layers[layer * layer_size..], stride: 6 * self.dim, offset: row * self.dim, index }
    }

    fn head_row<'a>(&'a self, row: usize, index: &'a [u32]) -> Table<'a> {
        Table { data: &self.head, stride: 2 * self.dim, offset: row * self.dim, index }
    }
}

/// A block of rows of one sequence.
#[derive(Default)]
pub(crate) struct Block {
    /// The sequence that it belongs to.
    pub(crate) sequence: usize,
    /// Its first row in the sequence.
    pub(crate) first: usize,
    /// Rows.
    pub(crate) rows: usize,
    /// The time of each row.
    pub(crate) index: Vec<u32>,
    /// Input, then normed rows.
    pub(crate) y: Buffer,
    /// Keys and values that the cache may keep.
    pub(crate) capture: Option<Pooled<Buffer>>,
    /// Result.
    pub(crate) output: Buffer,
    x: Buffer,
    qkv: Buffer,
    hidden: Buffer,
    attended: Buffer,
    tiles: Tiles,
}

impl Block {
    /// Embeds the input that lies in `y`.
    pub(crate) fn enter(&mut self, arch: Arch, patch: &Packed) {
        self.x.resize(self.rows * patch.columns);
        let source = Source::rows(&self.y, patch.depth);
        product(arch, self.rows, &[source], patch, Target::rows(&mut self.x, patch.columns), Finish::Plain);
    }

    /// Makes queries, keys and values of a layer.
    pub(crate) fn project(
        &mut self,
        arch: Arch,
        layer: (usize, &Layer),
        modulation: &Modulation,
        rotary: &Rotary,
        head_dim: usize,
        keys: &mut Keys,
    ) {
        let ((at, layer), dim, rows) = (layer, modulation.dim, self.rows);
        let (scale, shift) = (modulation.row(at, 1, &self.index), modulation.row(at, 0, &self.index));
        self.y.resize(rows * dim);
        layer_norm(arch, dim, &self.x, &mut self.y, After::Modulation { scale, shift });
        self.qkv.resize(rows * 3 * dim);
        let source = Source::rows(&self.y, dim);
        let target = Target::rows(&mut self.qkv, 3 * dim);
        product(arch, rows, &[source], &layer.attention.project, target, Finish::Plain);
        rms_norm(arch, &mut self.qkv, 0, 3 * dim, &layer.attention.norm_q);
        rms_norm(arch, &mut self.qkv, dim, 3 * dim, &layer.attention.norm_k);
        if let Some(capture) = &mut self.capture {
            let (kept, others) = capture[at * 2 * rows * dim..(at + 1) * 2 * rows * dim].split_at_mut(rows * dim);
            let kept = kept.chunks_exact_mut(dim).zip(others.chunks_exact_mut(dim));
            for (row, (k, v)) in self.qkv.chunks_exact(3 * dim).zip(kept) {
                k.copy_from_slice(&row[dim..2 * dim]);
                v.copy_from_slice(&row[2 * dim..]);
            }
        }
        rotary.apply(arch, &mut self.qkv, [0, 3 * dim, 2 * dim], self.first);
        keys.reset(rows, dim / head_dim, head_dim);
        keys.fill(0, &self.qkv[dim..], &self.qkv[2 * dim..], 3 * dim, head_dim);
    }

    /// Attends and does the rest of a layer.
    pub(crate) fn conclude(
        &mut self,
        arch: Arch,
        layer: (usize, &Layer),
        modulation: &Modulation,
        head_dim: usize,
        seen: Seen<'_>,
        context: Option<&Keys>,
    ) {
        let ((at, layer), dim, rows) = (layer, modulation.dim, self.rows);
        self.attended.resize(rows * dim);
        let queries = Source { data: &self.qkv, offset: 0, stride: 3 * dim, depth: dim };
        attend(arch, queries, seen, head_dim, &mut self.tiles, &mut self.attended);
        let gate = Finish::Gate(modulation.row(at, 2, &self.index));
        let source = Source::rows(&self.attended, dim);
        product(arch, rows, &[source], &layer.attention.out, Target::rows(&mut self.x, dim), gate);
        if let (Some(cross), Some(context)) = (&layer.cross, context) {
            self.look_up(arch, cross, context, head_dim, dim);
        }
        let (scale, shift) = (modulation.row(at, 4, &self.index), modulation.row(at, 3, &self.index));
        layer_norm(arch, dim, &self.x, &mut self.y, After::Modulation { scale, shift });
        let [first, second] = &layer.ffn;
        self.hidden.resize(rows * first.columns);
        let target = Target::rows(&mut self.hidden, first.columns);
        product(arch, rows, &[Source::rows(&self.y, dim)], first, target, Finish::Gelu);
        let gate = Finish::Gate(modulation.row(at, 5, &self.index));
        let source = Source::rows(&self.hidden, first.columns);
        product(arch, rows, &[source], second, Target::rows(&mut self.x, dim), gate);
    }

    /// Attends to the context.
    fn look_up(&mut self, arch: Arch, cross: &Cross, context: &Keys, head_dim: usize, dim: usize) {
        let [weight, bias] = &cross.norm;
        layer_norm(arch, dim, &self.x, &mut self.y, After::Affine { weight, bias });
        let source = Source::rows(&self.y, dim);
        let target = Target::rows(&mut self.qkv, 3 * dim);
        product(arch, self.rows, &[source], &cross.attention.project, target, Finish::Plain);
        rms_norm(arch, &mut self.qkv, 0, 3 * dim, &cross.attention.norm_q);
        let queries = Source { data: &self.qkv, offset: 0, stride: 3 * dim, depth: dim };
        let seen = Seen { window: Some(context), blocks: &[] };
        attend(arch, queries, seen, head_dim, &mut self.tiles, &mut self.attended);
        let source = Source::rows(&self.attended, dim);
        let target = Target::rows(&mut self.x, dim);
        product(arch, self.rows, &[source], &cross.attention.out, target, Finish::Add);
    }

    /// Writes the result.
    pub(crate) fn leave(&mut self, arch: Arch, head: &Packed, modulation: &Modulation) {
        let dim = modulation.dim;
        let (scale, shift) = (modulation.head_row(1, &self.index), modulation.head_row(0, &self.index));
        layer_norm(arch, dim, &self.x, &mut self.y, After::Modulation { scale, shift });
        self.output.resize(self.rows * head.columns);
        let target = Target::rows(&mut self.output, head.columns);
        product(arch, self.rows, &[Source::rows(&self.y, dim)], head, target, Finish::Plain);
    }
}

//! Fused attention: scores of 8 queries against all keys stay in one small tile, which becomes weights in place.
//!
//! Keys come in groups, as the cached window and each block of rows hold their own: per head a [head width, keys]
//! matrix in panels, and the values as a [keys, head width] matrix in panels. Queries are scaled by log2(e) / √width
//! beforehand, so that weights are powers of two.

use pulp::{Simd, WithSimd};

use super::Buffer;
use super::arch::Arch;
use super::lanes::{exponentials, largest};
use super::panels::{padded, panels};
use super::product::{ROWS, Source, multiply};

/// Keys and values of some tokens for all heads of one layer, packed.
#[derive(Default)]
pub(crate) struct Keys {
    count: usize,
    keys: Buffer,
    values: Buffer,
}

impl Keys {
    /// Makes room for a number of tokens; what was there is forgotten.
    pub(crate) fn reset(&mut self, count: usize, heads: usize, head_dim: usize) {
        self.count = count;
        self.keys.resize(heads * head_dim * padded(count));
        self.values.resize(heads * count * padded(head_dim));
    }

    /// Takes rotated keys and values of the tokens from `first` on; rows lie `stride` apart, head after head.
    pub(crate) fn fill(&mut self, first: usize, keys: &[f32], values: &[f32], stride: usize, head_dim: usize) {
        let (count, width) = (self.count, padded(head_dim));
        let heads = self.values.len() / (count * width);
        let rows = keys.len().div_ceil(stride);
        for head in 0..heads {
            let block = &mut self.keys[head * head_dim * padded(count)..(head + 1) * head_dim * padded(count)];
            for panel in panels(count) {
                let from = panel.first.max(first);
                let to = (panel.first + panel.width).min(first + rows);
                let part = &mut block[panel.first * head_dim..(panel.first + panel.width) * head_dim];
                for token in from..to {
                    let at = (token - first) * stride + head * head_dim;
                    let slots = part[token - panel.first..].iter_mut().step_by(panel.width);
                    slots.zip(&keys[at..at + head_dim]).for_each(|(slot, key)| *slot = *key);
                }
            }
            let block = &mut self.values[head * count * width..(head + 1) * count * width];
            for panel in panels(head_dim) {
                let columns = panel.width.min(head_dim - panel.first);
                for row in 0..rows {
                    let at = row * stride + head * head_dim + panel.first;
                    let to = panel.first * count + (first + row) * panel.width;
                    block[to..to + columns].copy_from_slice(&values[at..at + columns]);
                }
            }
        }
    }
}

/// Groups of keys that the same queries see: a window first, then blocks.
#[derive(Clone, Copy)]
pub(crate) struct Seen<'a> {
    pub(crate) window: Option<&'a Keys>,
    pub(crate) blocks: &'a [Keys],
}

impl<'a> Seen<'a> {
    fn groups(self) -> impl Iterator<Item = &'a Keys> {
        self.window.into_iter().chain(self.blocks)
    }

    /// Returns the scores of a query, padding included.
    pub(crate) fn width(self) -> usize {
        self.groups().map(|group| padded(group.count)).sum()
    }
}

/// The tiles of one block's attention.
#[derive(Default)]
pub(crate) struct Tiles {
    scores: Buffer,
    mixed: Buffer,
}

/// Attends from the rows of `queries`, which hold all heads side by side, to what they see; `out` is
/// [rows, heads·head_dim].
pub(crate) fn attend(
    arch: Arch,
    queries: Source<'_>,
    seen: Seen<'_>,
    head_dim: usize,
    tiles: &mut Tiles,
    out: &mut [f32],
) {
    tiles.scores.resize(ROWS * seen.width());
    tiles.mixed.resize(ROWS * padded(head_dim));
    arch.dispatch(Attend { queries, seen, head_dim, tiles, out });
}

struct Attend<'a, 'b> {
    queries: Source<'a>,
    seen: Seen<'a>,
    head_dim: usize,
    tiles: &'b mut Tiles,
    out: &'b mut [f32],
}

impl WithSimd for Attend<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { queries, seen, head_dim, tiles, out } = self;
        let (scores, tile): (&mut [f32], &mut [f32]) = (&mut tiles.scores, &mut tiles.mixed);
        let (dim, width) = (queries.depth, seen.width());
        let rows = out.len() / dim;
        let wide = padded(head_dim);
        for head in 0..dim / head_dim {
            let query = Source { offset: queries.offset + head * head_dim, depth: head_dim, ..queries };
            for first in (0..rows).step_by(ROWS) {
                score(simd, query, [first, rows - 1], head, seen, scores);
                let mut totals = [0.0; ROWS];
                for (row, total) in scores.chunks_exact_mut(width).zip(&mut totals) {
                    let top = largest(row);
                    *total = exponentials(row, top);
                }
                mix(simd, head, seen, scores, head_dim, tile);
                for row in first..rows.min(first + ROWS) {
                    let factor = 1.0 / totals[row - first];
                    let mixed = &tile[(row - first) * wide..][..head_dim];
                    let out = &mut out[row * dim + head * head_dim..][..head_dim];
                    out.iter_mut().zip(mixed).for_each(|(out, mixed)| *out = mixed * factor);
                }
            }
        }
    }
}

/// Scores of 8 queries against every group, side by side; padding gets −∞.
#[inline(always)]
fn score<S: Simd>(simd: S, query: Source<'_>, rows: [usize; 2], head: usize, seen: Seen<'_>, scores: &mut [f32]) {
    let (width, depth) = (seen.width(), query.depth);
    let mut at = 0;
    for group in seen.groups() {
        let keys = &group.keys[head * depth * padded(group.count)..(head + 1) * depth * padded(group.count)];
        for panel in panels(group.count) {
            let values = &keys[panel.first * depth..(panel.first + panel.width) * depth];
            let out = &mut scores[at + panel.first..];
            multiply(simd, panel.width, &[query], rows, values, out, width, false);
        }
        let (end, next) = (at + group.count, at + padded(group.count));
        for row in 0..ROWS {
            scores[row * width + end..row * width + next].fill(f32::NEG_INFINITY);
        }
        at = next;
    }
}

/// Sums values by weight over every group into 8 rows of a padded head.
#[inline(always)]
fn mix<S: Simd>(simd: S, head: usize, seen: Seen<'_>, weights: &[f32], head_dim: usize, tile: &mut [f32]) {
    let (width, wide) = (seen.width(), padded(head_dim));
    let mut at = 0;
    for group in seen.groups() {
        let values = &group.values[head * group.count * wide..(head + 1) * group.count * wide];
        for panel in panels(head_dim) {
            let source = Source { data: weights, offset: at, stride: width, depth: group.count };
            let part = &values[panel.first * group.count..(panel.first + panel.width) * group.count];
            multiply(simd, panel.width, &[source], [0, ROWS - 1], part, &mut tile[panel.first..], wide, at > 0);
        }
        at += padded(group.count);
    }
}

//! The rotary embedding as tables per row: cosine and sine of every pair of a head, angles in f64.
//!
//! Pairs are adjacent elements (2i, 2i+1): first the temporal ones, then those by row and by column of the frame.

use ds_nn::dit::DitShape;
use pulp::{Simd, WithSimd};

use super::Buffer;
use super::arch::Arch;

/// Cosines and sines of the pairs of some rows.
#[derive(Default, Clone)]
pub(crate) struct Rotary {
    cos: Buffer,
    sin: Buffer,
    pairs: usize,
}

/// The spatial part of a table, which is the same for all frames.
pub(crate) struct Grid {
    head_dim: usize,
    tokens: usize,
    cos: Vec<f32>,
    sin: Vec<f32>,
}

#[expect(clippy::cast_possible_truncation, reason = "tables are single precision")]
fn turn(position: usize, pair: usize, size: usize) -> (f32, f32) {
    let angle = position as f64 * 10_000f64.powf(-(pair as f64) / size as f64);
    (angle.cos() as f32, angle.sin() as f32)
}

impl Grid {
    pub(crate) fn new(shape: &DitShape) -> Self {
        let (head_dim, columns) = (shape.dim / shape.heads, shape.grid_w);
        let side = head_dim / 2 / 3;
        let (mut cos, mut sin) = (Vec::new(), Vec::new());
        for token in 0..shape.tokens() {
            for at in [token / columns, token % columns] {
                for pair in 0..side {
                    let (c, s) = turn(at, pair, side);
                    cos.push(c);
                    sin.push(s);
                }
            }
        }
        Self { head_dim, tokens: shape.tokens(), cos, sin }
    }

    /// Returns the width of a head.
    pub(crate) fn head_dim(&self) -> usize {
        self.head_dim
    }

    /// Fills a table with all tokens of the frames at the given temporal positions.
    pub(crate) fn fill(&self, positions: &[usize], table: &mut Rotary) {
        let pairs = self.head_dim / 2;
        let side = pairs / 3;
        let temporal = pairs - 2 * side;
        let tokens = self.tokens;
        table.pairs = pairs;
        table.cos.resize(positions.len() * tokens * pairs);
        table.sin.resize(positions.len() * tokens * pairs);
        let frames = table.cos.chunks_exact_mut(tokens * pairs).zip(table.sin.chunks_exact_mut(tokens * pairs));
        for (position, (cos, sin)) in positions.iter().zip(frames) {
            for pair in 0..temporal {
                let (c, s) = turn(*position, pair, temporal);
                for token in 0..tokens {
                    cos[token * pairs + pair] = c;
                    sin[token * pairs + pair] = s;
                }
            }
            for token in 0..tokens {
                let (from, to) = (token * 2 * side, token * pairs + temporal);
                cos[to..to + 2 * side].copy_from_slice(&self.cos[from..from + 2 * side]);
                sin[to..to + 2 * side].copy_from_slice(&self.sin[from..from + 2 * side]);
            }
        }
    }
}

impl Rotary {
    /// Rotates `width` values of rows that lie `stride` apart from `offset` on, row r by the table's row
    /// first + r.
    pub(crate) fn apply(&self, arch: Arch, values: &mut [f32], at: [usize; 3], first: usize) {
        self.turn(arch, values, at, first, 1.0);
    }

    /// Rotates back: the inverse of [`Self::apply`], which is also how gradients go through it.
    pub(crate) fn undo(&self, arch: Arch, values: &mut [f32], at: [usize; 3], first: usize) {
        self.turn(arch, values, at, first, -1.0);
    }

    fn turn(&self, arch: Arch, values: &mut [f32], [offset, stride, width]: [usize; 3], first: usize, sign: f32) {
        struct Op<'a> {
            table: &'a Rotary,
            values: &'a mut [f32],
            at: [usize; 3],
            first: usize,
            sign: f32,
        }
        impl WithSimd for Op<'_> {
            type Output = ();

            #[inline(always)]
            fn with_simd<S: Simd>(self, _: S) {
                let Self { table, values, at: [offset, stride, width], first, sign } = self;
                let pairs = table.pairs;
                for (row, values) in values.chunks_exact_mut(stride).enumerate() {
                    let at = (first + row) * pairs;
                    let (cos, sin) = (&table.cos[at..at + pairs], &table.sin[at..at + pairs]);
                    for head in values[offset..offset + width].chunks_exact_mut(2 * pairs) {
                        for ((pair, c), s) in head.as_chunks_mut::<2>().0.iter_mut().zip(cos).zip(sin) {
                            let ([a, b], s) = (*pair, sign * s);
                            *pair = [a * c - b * s, b * c + a * s];
                        }
                    }
                }
            }
        }
        arch.dispatch(Op { table: self, values, at: [offset, stride, width], first, sign });
    }
}

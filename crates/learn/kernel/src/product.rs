//! Rows times a packed matrix, with bias, activation, gate and residual applied while a tile is at hand.
//!
//! A tile is 8 rows by one panel. Its rows may come from several sources one after the other along the depth, and rows
//! of one source may overlap, as those of a convolution do. Every element is a chain of fused multiply-adds over the
//! depth in order, whatever the tile it falls in. Row tiles that reach past the end compute the last row again.

use pulp::{Simd, WithSimd};

use super::arch::Arch;
use super::lanes::{gelu, relu, silu};
use super::panels::{Packed, panels};

/// Rows of a tile.
pub(crate) const ROWS: usize = 8;
/// Columns of the widest panel.
pub(crate) const WIDEST: usize = 48;

/// Rows of `depth` values, each `stride` after the one before.
#[derive(Clone, Copy)]
pub(crate) struct Source<'a> {
    pub(crate) data: &'a [f32],
    pub(crate) offset: usize,
    pub(crate) stride: usize,
    pub(crate) depth: usize,
}

impl<'a> Source<'a> {
    /// Names rows that lie one after the other.
    pub(crate) fn rows(data: &'a [f32], depth: usize) -> Self {
        Self { data, offset: 0, stride: depth, depth }
    }
}

/// Where rows of a result go: row r begins at offset + r·stride.
pub(crate) struct Target<'a> {
    pub(crate) data: &'a mut [f32],
    pub(crate) offset: usize,
    pub(crate) stride: usize,
}

impl<'a> Target<'a> {
    /// Names rows that lie one after the other.
    pub(crate) fn rows(data: &'a mut [f32], stride: usize) -> Self {
        Self { data, offset: 0, stride }
    }
}

/// Values per row, looked up in a table: row r is at index[r]·stride + offset.
#[derive(Clone, Copy)]
pub(crate) struct Table<'a> {
    pub(crate) data: &'a [f32],
    pub(crate) stride: usize,
    pub(crate) offset: usize,
    pub(crate) index: &'a [u32],
}

impl<'a> Table<'a> {
    /// Returns the values of a row, from its offset on.
    #[inline(always)]
    pub(crate) fn row(&self, row: usize) -> &'a [f32] {
        &self.data[self.index[row] as usize * self.stride + self.offset..]
    }
}

/// What becomes of y = rows · matrix + bias.
#[derive(Clone, Copy)]
pub(crate) enum Finish<'a> {
    /// y.
    Plain,
    /// max(y, 0).
    Relu,
    /// gelu(y).
    Gelu,
    /// silu(y).
    Silu,
    /// target + y.
    Add,
    /// target + gate·y.
    Gate(Table<'a>),
    /// max(other + y, 0); rows of the other as of a source.
    ReluOfSum(Source<'a>),
    /// other + max(y, 0).
    SumWithRelu(Source<'a>),
}

/// Multiplies `rows` rows of the sources, laid end to end, with a matrix.
pub(crate) fn product(
    arch: Arch,
    rows: usize,
    sources: &[Source<'_>],
    packed: &Packed,
    target: Target<'_>,
    finish: Finish<'_>,
) {
    debug_assert_eq!(sources.iter().map(|source| source.depth).sum::<usize>(), packed.depth);
    arch.dispatch(Product { rows, sources, packed, target, finish });
}

struct Product<'a, 'b> {
    rows: usize,
    sources: &'a [Source<'a>],
    packed: &'a Packed,
    target: Target<'b>,
    finish: Finish<'a>,
}

#[repr(align(64))]
struct Tile([f32; ROWS * WIDEST]);

impl WithSimd for Product<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { rows, sources, packed, target, finish } = self;
        let mut tile = Tile([0.0; ROWS * WIDEST]);
        for panel in panels(packed.columns) {
            let values = packed.values(panel);
            let columns = panel.width.min(packed.columns - panel.first);
            let bias = &packed.bias[panel.first..panel.first + columns];
            for first in (0..rows).step_by(ROWS) {
                multiply(simd, panel.width, sources, [first, rows - 1], values, &mut tile.0, WIDEST, false);
                for row in first..rows.min(first + ROWS) {
                    let y = &mut tile.0[(row - first) * WIDEST..][..columns];
                    for (y, bias) in y.iter_mut().zip(bias) {
                        *y += bias;
                    }
                    let at = target.offset + row * target.stride + panel.first;
                    finish.apply(row, panel.first, y, &mut target.data[at..at + columns]);
                }
            }
        }
    }
}

impl Finish<'_> {
    /// Finishes part of a row, from `column` on.
    #[inline(always)]
    fn apply(self, row: usize, column: usize, y: &[f32], out: &mut [f32]) {
        let of = |source: Source<'_>| {
            let at = source.offset + row * source.stride + column;
            let y = y.len();
            at..at + y
        };
        match self {
            Self::Plain => out.copy_from_slice(y),
            Self::Relu => out.iter_mut().zip(y).for_each(|(out, y)| *out = relu(*y)),
            Self::Gelu => out.iter_mut().zip(y).for_each(|(out, y)| *out = gelu(*y)),
            Self::Silu => out.iter_mut().zip(y).for_each(|(out, y)| *out = silu(*y)),
            Self::Add => out.iter_mut().zip(y).for_each(|(out, y)| *out += y),
            Self::Gate(table) => {
                let gate = &table.row(row)[column..column + y.len()];
                out.iter_mut().zip(y).zip(gate).for_each(|((out, y), gate)| *out += gate * y);
            }
            Self::ReluOfSum(other) => {
                let other = &other.data[of(other)];
                out.iter_mut().zip(y).zip(other).for_each(|((out, y), other)| *out = relu(other + y));
            }
            Self::SumWithRelu(other) => {
                let other = &other.data[of(other)];
                out.iter_mut().zip(y).zip(other).for_each(|((out, y), other)| *out = other + relu(*y));
            }
        }
    }
}

/// Multiplies a tile of rows [first, last known] with a panel of `width` columns into 8 rows of `out`, which begin
/// `stride` apart; adds to what is there if told to.
#[inline(always)]
#[expect(clippy::too_many_arguments, reason = "the innermost call; a struct would be taken apart again")]
pub(crate) fn multiply<S: Simd>(
    simd: S,
    width: usize,
    sources: &[Source<'_>],
    rows: [usize; 2],
    panel: &[f32],
    out: &mut [f32],
    stride: usize,
    add: bool,
) {
    match width {
        48 => simd.vectorize(TileOf::<48, 3> { sources, rows, panel, out, stride, add }),
        32 => simd.vectorize(TileOf::<32, 2> { sources, rows, panel, out, stride, add }),
        _ => simd.vectorize(TileOf::<16, 1> { sources, rows, panel, out, stride, add }),
    }
}

/// One tile: WIDTH columns as VECTORS vectors at a time.
struct TileOf<'a, 'b, const WIDTH: usize, const VECTORS: usize> {
    sources: &'a [Source<'a>],
    rows: [usize; 2],
    panel: &'a [f32],
    out: &'b mut [f32],
    stride: usize,
    add: bool,
}

impl<const WIDTH: usize, const VECTORS: usize> WithSimd for TileOf<'_, '_, WIDTH, VECTORS> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let passes = WIDTH / (VECTORS * S::F32_LANES);
        for pass in 0..passes {
            if S::REGISTER_COUNT >= 32 {
                self.kernel::<S, ROWS>(simd, pass, 0);
            } else {
                self.kernel::<S, { ROWS / 2 }>(simd, pass, 0);
                self.kernel::<S, { ROWS / 2 }>(simd, pass, ROWS / 2);
            }
        }
    }
}

impl<const WIDTH: usize, const VECTORS: usize> TileOf<'_, '_, WIDTH, VECTORS> {
    #[inline(always)]
    fn kernel<S: Simd, const COUNT: usize>(&mut self, simd: S, pass: usize, skip: usize) {
        let [first, last] = self.rows;
        let mut sums = [[simd.splat_f32s(0.0); VECTORS]; COUNT];
        if self.add {
            for (row, sums) in sums.iter_mut().enumerate() {
                let line = S::as_simd_f32s(&self.out[(row + skip) * self.stride..][..WIDTH]).0;
                for (vector, sum) in sums.iter_mut().enumerate() {
                    *sum = line[pass * VECTORS + vector];
                }
            }
        }
        let mut panel = self.panel;
        for source in self.sources {
            let mut rows: [&[f32]; COUNT] = [&[]; COUNT];
            for (row, values) in rows.iter_mut().enumerate() {
                let at = source.offset + (first + skip + row).min(last) * source.stride;
                *values = &source.data[at..][..source.depth];
            }
            let (now, later) = panel.split_at(source.depth * WIDTH);
            panel = later;
            for (line, k) in now.as_chunks::<WIDTH>().0.iter().zip(0..source.depth) {
                let line = S::as_simd_f32s(line.as_slice()).0;
                let mut weights = [simd.splat_f32s(0.0); VECTORS];
                for (vector, weight) in weights.iter_mut().enumerate() {
                    *weight = line[pass * VECTORS + vector];
                }
                for row in 0..COUNT {
                    let value = simd.splat_f32s(rows[row][k]);
                    for vector in 0..VECTORS {
                        sums[row][vector] = simd.mul_add_e_f32s(value, weights[vector], sums[row][vector]);
                    }
                }
            }
        }
        for (row, sums) in sums.iter().enumerate() {
            let line = S::as_mut_simd_f32s(&mut self.out[(row + skip) * self.stride..][..WIDTH]).0;
            for (vector, sum) in sums.iter().enumerate() {
                line[pass * VECTORS + vector] = *sum;
            }
        }
    }
}

//! Norms of rows, with the modulation or the affine part in the same pass.

use pulp::{Simd, WithSimd};

use super::arch::Arch;
use super::lanes::sum;
use super::product::Table;

const EPSILON: f32 = 1e-6;

/// What follows a layer norm.
#[derive(Clone, Copy)]
pub(crate) enum After<'a> {
    /// ·(1 + scale) + shift, looked up per row.
    Modulation { scale: Table<'a>, shift: Table<'a> },
    /// ·weight + bias.
    Affine { weight: &'a [f32], bias: &'a [f32] },
}

/// Layer norm of `rows` rows of `width` values, from x to y.
pub(crate) fn layer_norm(arch: Arch, width: usize, x: &[f32], y: &mut [f32], after: After<'_>) {
    struct Op<'a> {
        width: usize,
        x: &'a [f32],
        y: &'a mut [f32],
        after: After<'a>,
    }
    impl WithSimd for Op<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) {
            let Self { width, x, y, after } = self;
            for (row, (x, y)) in x.chunks_exact(width).zip(y.chunks_exact_mut(width)).enumerate() {
                let mean = sum(x, |x| x) / width as f32;
                let variance = sum(x, |x| (x - mean) * (x - mean)) / width as f32;
                let factor = 1.0 / (variance + EPSILON).sqrt();
                match after {
                    After::Modulation { scale, shift } => {
                        let (scale, shift) = (&scale.row(row)[..width], &shift.row(row)[..width]);
                        for (((y, x), scale), shift) in y.iter_mut().zip(x).zip(scale).zip(shift) {
                            *y = (x - mean) * factor * (1.0 + scale) + shift;
                        }
                    }
                    After::Affine { weight, bias } => {
                        for (((y, x), weight), bias) in y.iter_mut().zip(x).zip(weight).zip(bias) {
                            *y = (x - mean) * factor * weight + bias;
                        }
                    }
                }
            }
        }
    }
    arch.dispatch(Op { width, x, y, after });
}

/// x / √(mean(x²) + ε) · weight in place, over the first values of rows that lie `stride` apart, from `offset` on.
pub(crate) fn rms_norm(arch: Arch, values: &mut [f32], offset: usize, stride: usize, weight: &[f32]) {
    struct Op<'a> {
        values: &'a mut [f32],
        offset: usize,
        stride: usize,
        weight: &'a [f32],
    }
    impl WithSimd for Op<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) {
            let Self { values, offset, stride, weight } = self;
            for row in values.chunks_exact_mut(stride) {
                let x = &mut row[offset..offset + weight.len()];
                let square = sum(x, |x| x * x) / weight.len() as f32;
                let factor = 1.0 / (square + EPSILON).sqrt();
                for (x, weight) in x.iter_mut().zip(weight) {
                    *x = *x * factor * weight;
                }
            }
        }
    }
    arch.dispatch(Op { values, offset, stride, weight });
}

//! Attention over latent frames: the rotary embedding and the softmax attention.
//!
//! Rotary pairs are adjacent elements (2i, 2i+1). A head of D elements has c = D/2 pairs: c − 2⌊c/3⌋ temporal ones,
//! then ⌊c/3⌋ by row and ⌊c/3⌋ by column, each axis with its own table (θ = 10000). Angles are computed in f64.

use burn::tensor::{DType, FloatDType, Tensor, activation, module, ops::AttentionModuleOptions};
use ds_nn::array::Array;

use crate::graph::{Graph, Mode};

/// Sizes that attention depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Heads {
    pub(crate) heads: usize,
    pub(crate) head_dim: usize,
    pub(crate) grid_h: usize,
    pub(crate) grid_w: usize,
}

impl Heads {
    /// Returns cosine and sine tables [frames·tokens, heads·head_dim] for frames at the given temporal positions.
    fn tables(&self, positions: &[usize]) -> (Array, Array) {
        let pairs = self.head_dim / 2;
        let side = pairs / 3;
        let sizes = [pairs - 2 * side, side, side];
        let width = self.heads * self.head_dim;
        let shape = [positions.len() * self.grid_h * self.grid_w, width];
        let (mut cos, mut sin) = (Vec::with_capacity(shape[0] * width), Vec::with_capacity(shape[0] * width));
        for position in positions {
            for token in 0..self.grid_h * self.grid_w {
                let at = [*position, token / self.grid_w, token % self.grid_w];
                let (mut row_cos, mut row_sin) = (Vec::new(), Vec::new());
                for (axis, size) in sizes.iter().enumerate() {
                    for pair in 0..*size {
                        let angle = at[axis] as f64 * 10_000f64.powf(-(pair as f64) / *size as f64);
                        #[expect(clippy::cast_possible_truncation, reason = "tables are single precision")]
                        let (c, s) = (angle.cos() as f32, angle.sin() as f32);
                        row_cos.extend([c, c]);
                        row_sin.extend([s, s]);
                    }
                }
                for _ in 0..self.heads {
                    cos.extend_from_slice(&row_cos);
                    sin.extend_from_slice(&row_sin);
                }
            }
        }
        (Array::new(&shape, cos), Array::new(&shape, sin))
    }

    /// Returns the tables on the device.
    pub(crate) fn rotation(&self, graph: &Graph, positions: &[usize]) -> Rotation {
        let (cos, sin) = self.tables(positions);
        let dim = self.head_dim;
        let swap = graph.constant("rope", || {
            let mut swap = Array::zeros(&[dim, dim]);
            for pair in 0..dim / 2 {
                swap.values_mut()[(2 * pair + 1) * dim + 2 * pair] = -1.0;
                swap.values_mut()[2 * pair * dim + 2 * pair + 1] = 1.0;
            }
            swap
        });
        let rows = cos.shape()[0];
        let wide = |table: Array| graph.tensor::<2>(&table).reshape([1, rows, self.heads * dim]);
        Rotation { cos: wide(cos), sin: wide(sin), swap }
    }

    /// Softmax attention of q [B, N, d] over k and v [B, M, d].
    pub(crate) fn attend(&self, mode: Mode, q: Tensor<3>, k: Tensor<3>, v: Tensor<3>) -> Tensor<3> {
        attend(mode, self.heads, [q, k, v])
    }
}

/// Softmax attention of q [B, N, d] over k and v [B, M, d], in heads of equal width.
pub(crate) fn attend(mode: Mode, heads: usize, qkv: [Tensor<3>; 3]) -> Tensor<3> {
    let [b, n, d] = qkv[0].dims();
    let [q, k, v] = qkv.map(|x| {
        let m = x.dims()[1];
        x.reshape([b, m, heads, d / heads]).swap_dims(1, 2)
    });
    let y = match mode {
        Mode::Infer => inferred([q, k, v]),
        Mode::Train => softened(q, k, v),
    };
    y.swap_dims(1, 2).reshape([b, n, d]).cast(FloatDType::F32)
}

/// Scores of so many queries are held at once.
const SCORES: usize = 1 << 28;

/// Softmax attention of heads [B, heads, N, D] without gradients. The framework's own softens scores in the format of what it is
/// given, and devices that multiply bf16 need not compile its exponentials; so those go by blocks of queries, softened in f32.
pub(crate) fn inferred([q, k, v]: [Tensor<4>; 3]) -> Tensor<4> {
    if v.dtype() == DType::F32 {
        return module::attention(q, k, v, None, None, AttentionModuleOptions::default());
    }
    let ([b, heads, n, d], seen) = (q.dims(), k.dims()[2]);
    let rows = (SCORES / (b * heads * seen)).clamp(1, n);
    let block = |from: usize| {
        let q = q.clone().slice([0..b, 0..heads, from..(from + rows).min(n), 0..d]);
        softened(q, k.clone(), v.clone())
    };
    Tensor::cat((0..n).step_by(rows).map(block).collect(), 2)
}

/// Softmax attention of heads [B, heads, N, D] by separate operations, scores in f32.
fn softened(q: Tensor<4>, k: Tensor<4>, v: Tensor<4>) -> Tensor<4> {
    let (scale, format) = (1.0 / (q.dims()[3] as f64).sqrt(), v.dtype());
    let scores = q.matmul(k.swap_dims(2, 3)).cast(FloatDType::F32).mul_scalar(scale);
    activation::softmax(scores, 3).cast(format).matmul(v)
}

/// Rotary tables of some frames.
pub(crate) struct Rotation {
    cos: Tensor<3>,
    sin: Tensor<3>,
    swap: Tensor<2>,
}

impl Rotation {
    /// Rotates x [B, frames·tokens, d].
    pub(crate) fn apply(&self, x: Tensor<3>) -> Tensor<3> {
        let [b, n, d] = x.dims();
        let dim = self.swap.dims()[0];
        let x = x.cast(FloatDType::F32);
        let swapped = x.clone().reshape([b * n * d / dim, dim]).matmul(self.swap.clone()).reshape([b, n, d]);
        x * self.cos.clone() + swapped * self.sin.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn head_pairs_split_as_published() {
        for (dim, split) in [(128, [22, 21, 21]), (64, [12, 10, 10]), (32, [6, 5, 5])] {
            let pairs = dim / 2;
            assert_eq!([pairs - 2 * (pairs / 3), pairs / 3, pairs / 3], split);
        }
    }

    #[test]
    fn attention_in_bf16_is_that_in_f32_up_to_its_rounding() {
        let device = crate::device::current();
        let drawn = |seed: f32, n: usize| {
            let values: Vec<f32> = (0..2 * 3 * n * 8).map(|i| (i as f32 * seed).sin()).collect();
            Tensor::<1>::from_floats(values.as_slice(), &device).reshape([2, 3, n, 8])
        };
        let exact = [drawn(0.37, 5), drawn(0.61, 9), drawn(0.83, 9)];
        let lowered = exact.clone().map(|x| x.cast(FloatDType::BF16));
        let (exact, lowered) = (inferred(exact), inferred(lowered).cast(FloatDType::F32));
        let apart = (exact - lowered).abs().max().into_scalar::<f32>();
        assert!(apart < 0.02 && apart > 0.0, "{apart}");
    }

    #[test]
    fn rotation_keeps_lengths_and_depends_on_differences_alone() {
        let heads = Heads { heads: 1, head_dim: 12, grid_h: 1, grid_w: 1 };
        let graph = Graph::new(&ds_nn::Weights::default(), Mode::Infer);
        let x: Vec<f32> = (0..12).map(|i| (i as f32 * 0.7).sin()).collect();
        let y: Vec<f32> = (0..12).map(|i| (i as f32 * 0.3).cos()).collect();
        let turn = |values: &[f32], position: usize| {
            let x = graph.tensor::<3>(&Array::new(&[1, 1, 12], values.to_vec()));
            crate::graph::array_of(heads.rotation(&graph, &[position]).apply(x)).into_values()
        };
        let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
        assert!((dot(&turn(&x, 9), &turn(&x, 9)) - dot(&x, &x)).abs() < 1e-5);
        assert!((dot(&turn(&x, 9), &turn(&y, 4)) - dot(&turn(&x, 6), &turn(&y, 1))).abs() < 1e-5);
        assert!((dot(&turn(&x, 9), &turn(&y, 4)) - dot(&turn(&x, 9), &turn(&y, 3))).abs() > 1e-3);
    }
}

//! Norms of the transformer: LayerNorm with the rows that the timestep gives, and the RMS norm of queries and keys.

use burn::tensor::{Tensor, module};

use super::EPSILON;

/// Modulation rows [times, rows, d], one time for all frames or one per batch entry and frame.
pub(super) struct Modulation {
    pub(super) rows: Tensor<3>,
    pub(super) tokens: usize,
}

impl Modulation {
    fn row(&self, row: usize) -> Tensor<3> {
        let [times, _, d] = self.rows.dims();
        self.rows.clone().slice([0..times, row..row + 1, 0..d])
    }

    /// LayerNorm without affine, then ·(1 + scale) + shift.
    pub(super) fn norm(&self, x: Tensor<3>, scale: usize, shift: usize) -> Tensor<3> {
        let ([b, n, d], times) = (x.dims(), self.rows.dims()[0]);
        let (scale, shift) = (self.row(scale) + 1.0, self.row(shift));
        if times == 1 {
            return module::layer_norm(x, scale.reshape([d]), Some(shift.reshape([d])), EPSILON);
        }
        let x = x.reshape([times, self.tokens, d]);
        let centred = x.clone() - x.mean_dim(2);
        let variance = centred.clone().powi_scalar(2).mean_dim(2);
        let y = centred * (variance + EPSILON).sqrt().recip();
        (y * scale + shift).reshape([b, n, d])
    }

    pub(super) fn gate(&self, x: Tensor<3>, row: usize) -> Tensor<3> {
        let ([b, n, d], times) = (x.dims(), self.rows.dims()[0]);
        (x.reshape([times, b * n / times, d]) * self.row(row)).reshape([b, n, d])
    }
}

/// x / √(mean(x²) + ε) · weight, over the last axis.
pub(super) fn rms_norm(x: Tensor<3>, weight: &Tensor<1>) -> Tensor<3> {
    let scale = (x.clone().powi_scalar(2).mean_dim(2) + EPSILON).sqrt().recip();
    x * scale * weight.clone().reshape([1, 1, -1])
}

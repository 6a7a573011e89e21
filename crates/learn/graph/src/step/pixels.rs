//! Training steps of the autoencoder and of the guided decoder: reconstruction of frames.

use std::ops::Range;

use burn::tensor::Tensor;
use ds_nn::array::Weights;
use ds_nn::step::{AeBatch, DecoderBatch, Step};
use ds_nn::tiny_ae::{AeShape, BLOCK_PX, Memory};

use crate::graph::Mode;
use crate::step::{finish, scalar, weighted};
use crate::tiny_ae::TinyAe;

/// Reconstruction step: L1 + 0.1·L1 of the image gradients + penalty·mean z².
#[must_use]
pub fn autoencoder(shape: &AeShape, weights: &Weights, batch: &AeBatch) -> Step {
    let ae = TinyAe::bind(shape, weights, Mode::Train);
    let z = ae.encode_tensor(ae.graph.tensor(&batch.folded), batch.clips, &mut Memory::default());
    // Noise in units of the latents' own size: a fixed size would reward shrinking or growing them.
    let size = z.clone().detach().powi_scalar(2).mean().sqrt();
    let noisy = z.clone() + ae.graph.tensor::<4>(&batch.noise) * size.reshape([1, 1, 1, 1]);
    let frames = ae.decode_tensor(noisy, None, batch.clips, &mut Memory::default());
    let emphasis = ae.graph.tensor(&batch.emphasis);
    let (loss, mut parts) = reconstruction(frames, ae.graph.tensor(&batch.frames), emphasis, None);
    let square = z.powi_scalar(2).mean();
    parts.push(("z2", scalar(&square)));
    finish(&ae.graph, &(loss + square * batch.latent_penalty), parts)
}

/// L1 + 0.1·L1 of the image gradients of the error of frames whose values span −1 to 1, and of its change from frame to frame and that
/// of their texture as much as a decoder's batch asks for; means but that of texture are weighted by `emphasis`.
pub(super) fn reconstruction(
    frames: Tensor<4>,
    truth: Tensor<4>,
    emphasis: Tensor<4>,
    batch: Option<&DecoderBatch>,
) -> (Tensor<1>, Vec<(&'static str, f32)>) {
    let [n, h, w, c] = frames.dims();
    let texture = batch
        .filter(|batch| batch.texture > 0.0)
        .map(|batch| (textures(frames.clone()) - textures(truth.clone())).abs().mean() * batch.texture);
    let error = frames - truth;
    let part = |y: Range<usize>, x: Range<usize>| error.clone().slice([0..n, y, x, 0..c]);
    let weight = |y: Range<usize>, x: Range<usize>| emphasis.clone().slice([0..n, y, x, 0..1]);
    let across = weighted(part(0..h, 1..w) - part(0..h, 0..w - 1), Tensor::abs, weight(0..h, 1..w));
    let down = weighted(part(1..h, 0..w) - part(0..h - 1, 0..w), Tensor::abs, weight(1..h, 0..w));
    let absolute = weighted(error.clone(), Tensor::abs, emphasis.clone());
    let change = batch.filter(|batch| batch.change > 0.0).map(|batch| {
        let frames = |images: &Tensor<4>, skipped: usize| {
            let [_, _, _, channels] = images.dims();
            let clip = n / batch.clips;
            let clips = images.clone().reshape([batch.clips, clip, h, w * channels]);
            let part = clips.slice([0..batch.clips, skipped..clip + skipped - 1, 0..h, 0..w * channels]);
            part.reshape([batch.clips * (clip - 1), h, w, channels])
        };
        weighted(frames(&error, 1) - frames(&error, 0), Tensor::abs, frames(&emphasis, 1)) * batch.change
    });
    let mse = scalar(&error.powi_scalar(2).mean());
    // The peak-to-peak range is 2.
    let parts = vec![("l1", scalar(&absolute)), ("psnr_db", 10.0 * (4.0 / mse).log10())];
    let still = absolute + (across + down) * 0.1;
    (change.into_iter().chain(texture).fold(still, Tensor::add), parts)
}

/// Returns how much neighbouring values of images differ on average within each block.
fn textures(images: Tensor<4>) -> Tensor<1> {
    let [n, h, w, c] = images.dims();
    let (rows, columns) = (n * h / BLOCK_PX, w / BLOCK_PX);
    let blocks = images.reshape([rows, BLOCK_PX, columns, BLOCK_PX, c]);
    let part = |y: Range<usize>, x: Range<usize>| blocks.clone().slice([0..rows, y, 0..columns, x, 0..c]);
    let (whole, inner) = (0..BLOCK_PX, BLOCK_PX - 1);
    let down = (part(1..BLOCK_PX, whole.clone()) - part(0..inner, whole.clone())).abs();
    let across = (part(whole.clone(), 1..BLOCK_PX) - part(whole, 0..inner)).abs();
    let [down, across] =
        [down, across].map(|steps| steps.mean_dim(1).mean_dim(3).mean_dim(4).reshape([rows * columns]));
    (down + across) * 0.5
}

/// Decoder step: the reconstruction loss, with gradients for the decoder's weights alone.
#[must_use]
pub fn decoder(shape: &AeShape, weights: &Weights, batch: &DecoderBatch) -> Step {
    let ae = TinyAe::bind(shape, weights, Mode::Train);
    let guide = (shape.guides > 0).then(|| ae.graph.tensor(&batch.guide));
    let frames = ae.decode_tensor(ae.graph.tensor(&batch.latents), guide, batch.clips, &mut Memory::default());
    let emphasis = ae.graph.tensor(&batch.emphasis);
    let (loss, parts) = reconstruction(frames, ae.graph.tensor(&batch.frames), emphasis, Some(batch));
    let mut step = finish(&ae.graph, &loss, parts);
    for name in weights.iter().map(|(name, _)| name).filter(|name| name.starts_with("encoder.")) {
        step.gradient.remove(name);
    }
    step
}

//! The adversarial step of a decoder and that of its discriminator: the framework's counterpart of
//! `ds_kernel::train::adversarial`, where the losses are explained.

use burn::tensor::{Tensor, activation};
use ds_nn::array::Weights;
use ds_nn::step::{Adversary, DecoderBatch, Step};
use ds_nn::tiny_ae::{AeShape, Memory};

use super::pixels::reconstruction;
use super::{finish, scalar};
use crate::graph::{Graph, Linear, Mode, array_of, channels, fold};
use crate::tiny_ae::TinyAe;

/// What is left of negative values.
const LEAK: f64 = 0.2;

struct Discriminator {
    graph: Graph,
    layers: Vec<Linear>,
    layouts: Tensor<4>,
    clips: usize,
}

impl Discriminator {
    fn bind(against: &Adversary<'_>, batch: &DecoderBatch) -> Self {
        let graph = Graph::new(against.weights, Mode::Train);
        let layers = (0..against.shape.inputs().len()).map(|index| graph.linear(&format!("layer.{index}"))).collect();
        let layouts = channels(&graph.tensor(&batch.guide), 0..3);
        Self { layers, layouts, graph, clips: batch.clips }
    }

    /// Looks at pairs of neighbouring frames; returns what comes out of each layer, the verdicts last.
    fn look(&self, frames: &Tensor<4>) -> Vec<Tensor<4>> {
        let [n, h, w, c] = frames.dims();
        let per_clip = n / self.clips;
        let cut = |images: &Tensor<4>, from: usize| {
            let clips = images.clone().reshape([self.clips, per_clip, h, w, c]);
            let part = clips.slice([0..self.clips, from..from + per_clip - 1, 0..h, 0..w, 0..c]);
            part.reshape([self.clips * (per_clip - 1), h, w, c])
        };
        let mut x = Tensor::cat(vec![cut(frames, 1), cut(frames, 0), cut(&self.layouts, 1)], 3);
        let (mut outputs, last) = (Vec::new(), self.layers.len() - 1);
        for (index, layer) in self.layers.iter().enumerate() {
            x = layer.convolve(if index < last { fold(x, 2) } else { x });
            if index < last {
                x = activation::leaky_relu(x, LEAK);
            }
            outputs.push(x.clone());
        }
        outputs
    }
}

/// Computes the decoder's step against a discriminator, and the discriminator's against the decoder.
///
/// # Panics
/// If the framework keeps no gradient of the frames, or the discriminator has no layers.
#[must_use]
pub fn adversarial(shape: &AeShape, weights: &Weights, batch: &DecoderBatch, against: &Adversary<'_>) -> [Step; 2] {
    // A backward pass uses up the graph of what it went through: one discriminator to please, one to train.
    let ae = TinyAe::bind(shape, weights, Mode::Train);
    let [pleased, judge] = [(); 2].map(|()| Discriminator::bind(against, batch));
    let guide = (shape.guides > 0).then(|| ae.graph.tensor(&batch.guide));
    let frames = ae.decode_tensor(ae.graph.tensor(&batch.latents), guide, batch.clips, &mut Memory::default());
    let truth: Tensor<4> = ae.graph.tensor(&batch.frames);
    let slope_of = |loss: &dyn Fn(Tensor<4>) -> Tensor<1>| {
        let leaf = frames.clone().detach().require_grad();
        let gradients = loss(leaf.clone()).backward();
        ae.graph.tensor::<4>(&array_of(leaf.grad(&gradients).expect("the loss depends on the frames")))
    };
    let seen = |judge: &Discriminator, frames: &Tensor<4>| -> Vec<Tensor<4>> {
        judge.look(frames).into_iter().map(Tensor::detach).collect()
    };
    let real = seen(&pleased, &truth);
    let told_of = fooling(&seen(&pleased, &frames.clone().detach()), &real, batch, against).1;
    let pull = slope_of(&|frames| fooling(&pleased.look(&frames), &real, batch, against).0);
    let grey = pull.clone().mean_dim(3);
    let kept = ae.graph.tensor::<4>(&batch.emphasis).lower_elem(1.0).float() * (against.colour - 1.0) + 1.0;
    let pull = (pull - grey.clone()) * kept + grey;
    let target = truth.clone();
    let mut parts =
        reconstruction(frames.clone().detach(), truth.clone(), ae.graph.tensor(&batch.emphasis), Some(batch)).1;
    let loss =
        |frames: Tensor<4>| reconstruction(frames, target.clone(), ae.graph.tensor(&batch.emphasis), Some(batch)).0;
    let slope = slope_of(&loss);
    let size = |x: &Tensor<4>| scalar(&x.clone().powi_scalar(2).sum().sqrt());
    let share = against.share * size(&slope) / size(&pull).max(1e-30);
    let told = scalar(&loss(frames.clone().detach()));
    parts.extend(told_of);
    let mut decoder = finish(&ae.graph, &(frames.clone() * (slope + pull * share)).sum(), parts);
    decoder.loss = told;
    for name in weights.iter().map(|(name, _)| name).filter(|name| name.starts_with("encoder.")) {
        decoder.gradient.remove(name);
    }
    let noisy = truth.clone() + ae.graph.tensor(&against.noise);
    let verdicts = [frames.detach(), truth, noisy].map(|frames| judge.look(&frames).pop());
    let [fake, real, noisy] = verdicts.map(|verdict| verdict.expect("the discriminator has layers"));
    let hinges = activation::relu(fake + 1.0).mean() + activation::relu(-real.clone() + 1.0).mean();
    let smooth = (real.clone() - noisy).powi_scalar(2).mean() * against.smoothness;
    let judged = finish(&judge.graph, &(hinges + smooth), vec![("real", scalar(&real.mean()))]);
    [decoder, judged]
}

/// Returns how far frames are from being taken for true ones, and what that tells.
fn fooling(
    fake: &[Tensor<4>],
    real: &[Tensor<4>],
    batch: &DecoderBatch,
    against: &Adversary<'_>,
) -> (Tensor<1>, Vec<(&'static str, f32)>) {
    let last = fake.len() - 1;
    let verdict = fake[last].clone().mean();
    let pairs = fake[..last].iter().zip(real);
    let distances = pairs.map(|(fake, real)| (fake.clone() - real.clone()).abs().sum() / real.clone().abs().sum());
    let distance = distances.reduce(|sum, next| sum + next).filter(|_| batch.told);
    let parts = vec![("fake", scalar(&verdict)), ("features", distance.as_ref().map_or(0.0, scalar))];
    let loss = match distance {
        Some(distance) => distance * against.features - verdict,
        None => -verdict,
    };
    (loss, parts)
}

//! One training step of each network: the loss of a batch and the gradient of every weight.
//!
//! Convention: x_t = (1 − σ)·x0 + σ·ε, t = 1000·σ, flow v = ε − x0. Batches hold normalised latents as tokens
//! [B, frames, tokens, 4, z]; frame 0 is the given first frame o_0, always clean at t = 0 and never part of a loss.
//! All noise is drawn by the caller. A step of many clips is the mean of steps of few ([`Step::mean`]), which a
//! [`Team`](crate::team::Team) computes side by side.

mod bidirectional;
mod causal;
mod pixels;

use burn::tensor::Tensor;

use crate::array::{Array, Weights};
use crate::dit::{Context, Dit};
use crate::graph::Graph;

pub(crate) use bidirectional::SMALLEST_SIGMA;
pub(crate) use bidirectional::clean_by;
pub use bidirectional::{BidirectionalPlan, bidirectional, bidirectional_clean};
pub use causal::{CausalPlan, causal, causal_output};
pub(crate) use causal::{Group, groups};
pub use pixels::{AeBatch, DecoderBatch, autoencoder, decoder};

/// What the transformer's output stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Prediction {
    /// The clean latent x0.
    Clean,
    /// The flow ε − x0.
    Flow,
}

/// The loss of a batch and the gradient of every weight.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Loss before the update.
    pub loss: f32,
    /// Parts of the loss by name.
    pub parts: Vec<(&'static str, f32)>,
    /// Gradients, named as the weights.
    pub gradient: Weights,
}

impl Step {
    /// Returns the mean of steps of equally many clips, summed in their order.
    ///
    /// # Panics
    /// If there are no steps.
    #[must_use]
    pub fn mean(steps: Vec<Self>) -> Self {
        #[expect(clippy::cast_precision_loss, reason = "a batch has few parts")]
        let share = 1.0 / steps.len() as f32;
        let mut steps = steps.into_iter();
        let mut mean = steps.next().expect("a batch has at least one clip");
        for step in steps {
            mean.loss += step.loss;
            mean.parts.iter_mut().zip(&step.parts).for_each(|((_, sum), (_, value))| *sum += value);
            for ((_, sum), (_, array)) in mean.gradient.iter_mut().zip(step.gradient.iter()) {
                sum.values_mut().iter_mut().zip(array.values()).for_each(|(sum, value)| *sum += value);
            }
        }
        mean.parts.iter_mut().for_each(|(_, value)| *value *= share);
        mean.scaled(share)
    }

    /// Returns the step of the loss times a factor; its parts stay.
    #[must_use]
    pub fn scaled(mut self, factor: f32) -> Self {
        self.loss *= factor;
        self.gradient.iter_mut().for_each(|(_, array)| array.values_mut().iter_mut().for_each(|x| *x *= factor));
        self
    }
}

fn scalar(tensor: &Tensor<1>) -> f32 {
    tensor.clone().into_scalar::<f32>()
}

fn finish(graph: &Graph, loss: &Tensor<1>, parts: Vec<(&'static str, f32)>) -> Step {
    let gradient = graph.gradients(loss.backward());
    Step { loss: scalar(loss), parts, gradient }
}

/// Returns Σ w·f(x) / Σ w, with weights [.., 1] for values [.., channels].
fn weighted<const D: usize>(x: Tensor<D>, f: impl Fn(Tensor<D>) -> Tensor<D>, weight: Tensor<D>) -> Tensor<1> {
    (f(x) * weight.clone()).mean() / weight.mean()
}

/// Clips for the transformer.
#[derive(Debug, Clone)]
pub struct ClipBatch {
    /// Clean latents [B, F, tokens, 4, z]; frame 0 is given.
    pub clean: Array,
    /// The start latent: the first frame o_0 of the drive [B, tokens, 4, z]; frame 0 itself unless a clip begins later.
    pub start: Array,
    /// Space-to-depth layouts [B, F·tokens, 4, control inputs].
    pub layouts: Array,
    /// 1 where a clip shows its layout, 0 where it was dropped.
    pub layout_on: Vec<f32>,
    /// 1 where a clip shows frame 0, its start latent and its prompt, 0 where all were dropped.
    pub given_on: Vec<f32>,
    /// Prompt tokens [B, text_len, text_dim].
    pub text: Array,
    /// How much each latent pixel counts, [B, F, tokens, 4, 1].
    pub emphasis: Array,
}

/// A noise level: σ, and the timestep 1000·σ that labels it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level(pub f32);

/// What all frames of a batch are conditioned on; zeros where it was dropped.
struct Given {
    /// Frame 0, [B, 1, tokens, 4, z].
    first: Tensor<5>,
    /// The start latent in the same shape.
    start: Tensor<5>,
    context: Context,
}

impl Given {
    fn of(dit: &Dit, batch: &ClipBatch) -> Self {
        let [b, _, n, pixels, z]: [usize; 5] = batch.clean.shape().try_into().expect("clean latents have five axes");
        let kept = |array: &Array, per_clip: usize| {
            let clips = array.values().chunks(per_clip.max(1)).zip(&batch.given_on);
            clips.flat_map(|(clip, on)| clip.iter().map(move |value| value * on)).collect::<Vec<_>>()
        };
        let frame = n * pixels * z;
        let clips = batch.clean.values().len() / b;
        let first = batch.clean.values().chunks(clips).flat_map(|clip| &clip[..frame]).copied().collect();
        let first = kept(&Array::new(&[b, frame], first), frame);
        let start = Array::new(&[b, n, pixels, z], kept(&batch.start, frame));
        let text = Array::new(batch.text.shape(), kept(&batch.text, batch.text.values().len() / b));
        let context = dit.context(&text, &start);
        Self {
            first: dit.graph.tensor(&Array::new(&[b, 1, n, pixels, z], first)),
            start: dit.graph.tensor::<4>(&start).reshape([b, 1, n, pixels, z]),
            context,
        }
    }

    /// Returns the start latents of all frames.
    fn starts(&self, dit: &Dit, frames: usize) -> Tensor<5> {
        let [b, _, n, pixels, z] = self.start.dims();
        if dit.shape.start_every {
            return self.start.clone().repeat_dim(1, frames);
        }
        Tensor::cat(vec![self.start.clone(), Tensor::zeros([b, frames - 1, n, pixels, z], &dit.graph.device)], 1)
    }
}

fn control(dit: &Dit, batch: &ClipBatch) -> Tensor<4> {
    let control = dit.control(&batch.layouts).0;
    let on = dit.graph.tensor::<4>(&Array::new(&[batch.layout_on.len(), 1, 1, 1], batch.layout_on.clone()));
    control * on
}

#[cfg(test)]
mod tests;

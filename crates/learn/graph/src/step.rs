//! One training step of each network on the framework's graph: the loss of a batch and the gradient of every weight.
//! What goes in and comes out is described in [`ds_nn::step`].

mod adversarial;
mod bidirectional;
mod causal;
mod pixels;

use burn::tensor::Tensor;
use ds_nn::array::Array;
use ds_nn::step::{ClipBatch, Step};

use crate::dit::{Context, Dit};
use crate::graph::Graph;

pub use adversarial::adversarial;
pub use bidirectional::{bidirectional, bidirectional_clean, bidirectional_in, clean_by};
pub use causal::{causal, causal_in, causal_output};
pub use pixels::{autoencoder, decoder};

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
    let [clips, rows, pixels, _]: [usize; 4] = batch.layouts.shape().try_into().expect("layouts have four axes");
    if batch.layout_on.iter().all(|on| *on == 0.0) {
        return Tensor::zeros([clips, rows, pixels, dit.shape.control_channels], &dit.graph.device);
    }
    let control = dit.control(&batch.layouts).0;
    let on = dit.graph.tensor::<4>(&Array::new(&[batch.layout_on.len(), 1, 1, 1], batch.layout_on.clone()));
    control * on
}

#[cfg(test)]
mod tests;

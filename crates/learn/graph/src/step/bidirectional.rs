//! The bidirectional step of prior and teacher: flow matching over whole clips after a given first frame.
//!
//! One level per clip for frames 1..F, whatever the output stands for the loss is that of the flow v = ε − x0
//! (video-model.md 3.1): an output that is the clean latent is weighted by 1 / σ², from σ = [`SMALLEST_SIGMA`] up.

use burn::tensor::Tensor;
use ds_nn::array::{Array, Weights};
use ds_nn::dit::DitShape;
use ds_nn::step::{BidirectionalPlan, ClipBatch, Prediction, SMALLEST_SIGMA, Step};

use crate::device::Precision;
use crate::dit::{Dit, Qkv, Tokens};
use crate::graph::{Mode, array_of};
use crate::step::{Given, control, finish, weighted};

/// Computes a flow-matching step.
#[must_use]
pub fn bidirectional(shape: &DitShape, weights: &Weights, batch: &ClipBatch, plan: &BidirectionalPlan) -> Step {
    bidirectional_in(Precision::F32, shape, weights, batch, plan)
}

/// As [`bidirectional`], large layers and attention in a number format.
#[must_use]
pub fn bidirectional_in(
    precision: Precision,
    shape: &DitShape,
    weights: &Weights,
    batch: &ClipBatch,
    plan: &BidirectionalPlan,
) -> Step {
    let dit = Dit::bind_in(precision, shape, weights, Mode::Train);
    let clean = dit.graph.tensor::<5>(&batch.clean);
    let [b, frames, n, _, z] = clean.dims();
    let clean = clean.slice([0..b, 1..frames, 0..n, 0..4, 0..z]);
    let noise = dit.graph.tensor::<5>(&plan.noise);
    let per_clip = |values: Vec<f32>| dit.graph.tensor::<5>(&Array::new(&[b, 1, 1, 1, 1], values));
    let sigma = per_clip(plan.levels.clone());
    let noisy = clean.clone() * (sigma.clone() * -1.0 + 1.0) + noise.clone() * sigma;
    let output = forward(&dit, batch, noisy, &plan.levels);
    let error = match plan.prediction {
        Prediction::Flow => output - (noise - clean),
        Prediction::Clean => {
            let scale = plan.levels.iter().map(|sigma| 1.0 / sigma.max(SMALLEST_SIGMA)).collect();
            (output - clean) * per_clip(scale)
        }
    };
    let weight = dit.graph.tensor::<5>(&batch.emphasis).slice([0..b, 1..frames, 0..n, 0..4, 0..1]);
    let loss = weighted(error, |error| error.powi_scalar(2), weight);
    finish(&dit.graph, &loss, Vec::new())
}

/// Runs the network over the given first frames and noisy frames [B, F − 1, tokens, 4, z]; returns its output for the latter.
fn forward(dit: &Dit, batch: &ClipBatch, noisy: Tensor<5>, levels: &[f32]) -> Tensor<5> {
    let [b, later, n, _, z] = noisy.dims();
    let frames = later + 1;
    let given = Given::of(dit, batch);
    let times = levels.iter().flat_map(|level| [vec![0.0], vec![1000.0 * level; later]].concat()).collect();
    let rows = [b, frames * n, 4, z];
    let start = given.starts(dit, frames).reshape(rows);
    let noisy = Tensor::cat(vec![given.first.clone(), noisy], 1).reshape(rows);
    let tokens = Tokens { noisy, control: control(dit, batch), start, times };
    let heads = dit.heads();
    let rotation = heads.rotation(&dit.graph, &(0..frames).collect::<Vec<_>>());
    let output = dit.forward(tokens, &given.context, &mut |_, Qkv { q, k, v }| {
        let lower = |x| dit.graph.lower(x);
        heads.attend(dit.graph.mode, lower(rotation.apply(q)), lower(rotation.apply(k)), lower(v))
    });
    output.reshape([b, frames, n, 4, z]).slice([0..b, 1..frames, 0..n, 0..4, 0..z])
}

/// Predicts the clean latents of noisy frames [B, F − 1, tokens, 4, z] at one level per clip, without gradients.
#[must_use]
pub fn bidirectional_clean(
    shape: &DitShape,
    weights: &Weights,
    batch: &ClipBatch,
    noisy: &Array,
    levels: &[f32],
    prediction: Prediction,
) -> Array {
    clean_by(&Dit::bind(shape, weights, Mode::Infer), batch, noisy, levels, prediction)
}

/// As [`bidirectional_clean`], of bound weights.
#[must_use]
pub fn clean_by(dit: &Dit, batch: &ClipBatch, noisy: &Array, levels: &[f32], prediction: Prediction) -> Array {
    let output = array_of(forward(dit, batch, dit.graph.tensor(noisy), levels));
    match prediction {
        Prediction::Clean => output,
        Prediction::Flow => {
            let clip = noisy.values().len() / levels.len().max(1);
            let values = noisy.values().iter().zip(output.values()).enumerate();
            Array::new(noisy.shape(), values.map(|(at, (x, v))| x - levels[at / clip] * v).collect())
        }
    }
}

//! The causal step: chunks that see earlier chunks as the cache keeps them, in one parallel pass.
//!
//! A sequence holds o_0 clean, every later latent frame in the state that inference caches (the *context*), and some
//! frames once more in another state (the *queries*). Each chunk sees earlier context and itself, with the window, sink
//! and positions of the cache. What the states and targets are is the caller's choice: data with noise (diffusion
//! forcing), a teacher's trajectories (ODE initialisation, video-model.md 3.3) or the student's own rollout moved by
//! the distribution-matching gradient (Self Forcing, 3.4).

use std::ops::Range;

use burn::tensor::Tensor;
use ds_nn::array::{Array, Weights};
use ds_nn::dit::DitShape;
use ds_nn::step::{CausalPlan, ClipBatch, Group, Level, Prediction, Step, groups};

use crate::device::Precision;
use crate::dit::{Dit, Qkv, Tokens};
use crate::graph::{Mode, array_of};
use crate::step::{Given, control, finish, scalar, weighted};

/// The sequence [o_0 ++ context ++ queries] without o_0, and the network's output for all of it.
struct Sequence {
    context: Tensor<5>,
    query: Tensor<5>,
    output: Tensor<5>,
}

fn sequence(dit: &Dit, batch: &ClipBatch, plan: &CausalPlan) -> Sequence {
    let [b, frames, n, _, z]: [usize; 5] = batch.clean.shape().try_into().expect("clean latents have five axes");
    let given = Given::of(dit, batch);
    let (context, query) = (dit.graph.tensor::<5>(&plan.context), dit.graph.tensor::<5>(&plan.query));
    let all = frames + plan.queries.len();
    let labels = |level: Level, count: usize| vec![1000.0 * level.0; count];
    let later = labels(plan.query_level, plan.queries.len());
    let times = [vec![0.0], labels(plan.context_level, frames - 1), later].concat().repeat(b);
    let control = control(dit, batch);
    let channels = dit.shape.control_channels;
    let later = control.clone().slice([0..b, plan.queries.start * n..plan.queries.end * n, 0..4, 0..channels]);
    let start = given.starts(dit, all);
    let noisy = Tensor::cat(vec![given.first.clone(), context.clone(), query.clone()], 1);
    let rows = [b, all * n, 4, z];
    let tokens = Tokens {
        noisy: noisy.reshape(rows),
        control: Tensor::cat(vec![control, later], 1),
        start: start.reshape(rows),
        times,
    };
    let groups = groups(frames, plan);
    let positions: Vec<usize> = (0..frames).chain(plan.queries.clone()).collect();
    let detached = plan.context_detached;
    let output = dit.forward(tokens, &given.context, &mut |_, qkv| grouped(dit, &groups, &positions, qkv, detached));
    Sequence { context, query, output: output.reshape([b, all, n, 4, z]) }
}

/// Computes a causal step. The loss is the mean square error of the predicted clean latent over query frames and, if
/// trained, context frames, weighted by the batch's emphasis; half the mean of both where both carry loss.
#[must_use]
pub fn causal(shape: &DitShape, weights: &Weights, batch: &ClipBatch, plan: &CausalPlan) -> Step {
    causal_in(Precision::F32, shape, weights, batch, plan)
}

/// As [`causal`], large layers and attention in a number format.
#[must_use]
pub fn causal_in(
    precision: Precision,
    shape: &DitShape,
    weights: &Weights,
    batch: &ClipBatch,
    plan: &CausalPlan,
) -> Step {
    let dit = Dit::bind_in(precision, shape, weights, Mode::Train);
    let Sequence { context, query, output } = sequence(&dit, batch, plan);
    let [b, all, n, _, z] = output.dims();
    let frames = all - plan.queries.len();
    let part = |range: Range<usize>| output.clone().slice([0..b, range, 0..n, 0..4, 0..z]);
    let emphasis = dit.graph.tensor::<5>(&batch.emphasis);
    let target = dit.graph.tensor::<5>(&plan.target);
    let error = |output: Tensor<5>, noisy: Tensor<5>, level: Level, frames: Range<usize>| {
        let x0 = match plan.prediction {
            Prediction::Clean => output,
            Prediction::Flow => noisy - output * level.0,
        };
        let target = target.clone().slice([0..b, frames.start - 1..frames.end - 1, 0..n, 0..4, 0..z]);
        let weight = emphasis.clone().slice([0..b, frames, 0..n, 0..4, 0..1]);
        weighted(x0 - target, |error| error.powi_scalar(2), weight)
    };
    let (mut losses, mut parts) = (Vec::new(), Vec::new());
    if !plan.queries.is_empty() {
        let loss = error(part(frames..all), query, plan.query_level, plan.queries.clone());
        parts.push(("query", scalar(&loss)));
        losses.push(loss);
    }
    if plan.context_trained {
        let loss = error(part(1..frames), context, plan.context_level, 1..frames);
        parts.push(("context", scalar(&loss)));
        losses.push(loss);
    }
    #[expect(clippy::cast_precision_loss, reason = "one or two")]
    let share = 1.0 / losses.len().max(1) as f32;
    let loss = losses.into_iter().reduce(|a, b| a + b).expect("a causal step has queries or a trained context");
    finish(&dit.graph, &(loss * share), parts)
}

/// Runs the parallel causal form without gradients: the network's output for [o_0 ++ context ++ query] frames,
/// [B, F + queries, tokens, 4, z].
#[must_use]
pub fn causal_output(shape: &DitShape, weights: &Weights, batch: &ClipBatch, plan: &CausalPlan) -> Array {
    array_of(sequence(&Dit::bind(shape, weights, Mode::Infer), batch, plan).output)
}

fn grouped(dit: &Dit, groups: &[Group], positions: &[usize], qkv: Qkv, detached: bool) -> Tensor<3> {
    let (heads, n) = (dit.heads(), dit.shape.tokens());
    let [b, _, d] = qkv.q.dims();
    let rotation = heads.rotation(&dit.graph, positions);
    let (q, k) = (rotation.apply(qkv.q), rotation.apply(qkv.k.clone()));
    let part = |x: &Tensor<3>, range: &Range<usize>| x.clone().slice([0..b, range.start * n..range.end * n, 0..d]);
    let attend = |group: &Group| {
        let cached = |x: Tensor<3>| if detached { x.detach() } else { x };
        let sink = 0..group.sink;
        // Moving the sink forward by the evicted frames is the same as moving all others back.
        let sink_k = if group.evicted == 0 {
            part(&k, &sink)
        } else {
            let moved: Vec<usize> = sink.clone().map(|frame| frame + group.evicted).collect();
            heads.rotation(&dit.graph, &moved).apply(part(&qkv.k, &sink))
        };
        let (mut ks, mut vs) = (vec![], vec![]);
        if group.sink > 0 {
            ks.push(cached(sink_k));
            vs.push(cached(part(&qkv.v, &sink)));
        }
        if !group.past.is_empty() {
            ks.push(cached(part(&k, &group.past)));
            vs.push(cached(part(&qkv.v, &group.past)));
        }
        ks.push(part(&k, &group.own));
        vs.push(part(&qkv.v, &group.own));
        let lower = |x| dit.graph.lower(x);
        let (k, v) = (lower(Tensor::cat(ks, 1)), lower(Tensor::cat(vs, 1)));
        heads.attend(dit.graph.mode, lower(part(&q, &group.queries)), k, v)
    };
    Tensor::cat(groups.iter().map(attend).collect(), 1)
}

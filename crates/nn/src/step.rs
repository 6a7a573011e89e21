//! One training step of each network: the loss of a batch and the gradient of every weight.
//!
//! Convention: x_t = (1 − σ)·x0 + σ·ε, t = 1000·σ, flow v = ε − x0. Batches hold normalised latents as tokens
//! [B, frames, tokens, 4, z]. All noise is drawn by the caller.

use std::ops::Range;

use burn::tensor::Tensor;

use crate::array::{Array, Weights};
use crate::attention::Visible;
use crate::cache::{CachePolicy, Positions};
use crate::dit::{Dit, DitShape, Qkv, Tokens};
use crate::graph::{Graph, Mode, array_of};
use crate::tiny_ae::{AeShape, Memory, TinyAe};

/// What the transformer's output stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Prediction {
    /// The clean latent x0.
    Clean,
    /// The flow ε − x0.
    Flow,
}

/// The loss of a batch and the gradient of every weight.
pub struct Step {
    /// Loss before the update.
    pub loss: f32,
    /// Parts of the loss by name.
    pub parts: Vec<(&'static str, f32)>,
    /// Gradients, named as the weights.
    pub gradient: Weights,
}

fn scalar(tensor: &Tensor<1>) -> f32 {
    tensor.clone().into_scalar::<f32>()
}

fn finish(graph: &Graph, loss: &Tensor<1>, parts: Vec<(&'static str, f32)>) -> Step {
    let gradient = graph.gradients(loss.backward());
    Step { loss: scalar(loss), parts, gradient }
}

/// A batch for the autoencoder.
pub struct AeBatch {
    /// Clips.
    pub clips: usize,
    /// Space-to-depth frames, [clips·steps, h, w, inputs].
    pub folded: Array,
    /// The same frames as images of −1 to 1, [clips·steps·stride_t, 8h, 8w, 3].
    pub frames: Array,
    /// How much each pixel counts, [clips·steps·stride_t, 8h, 8w, 1].
    pub emphasis: Array,
    /// Noise that is added to the latents, in their shape and in units of their root mean square.
    pub noise: Array,
    /// Weight of the mean square of the latents.
    pub latent_penalty: f32,
}

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
    let (loss, mut parts) = reconstruction(frames - ae.graph.tensor(&batch.frames), emphasis);
    let square = z.powi_scalar(2).mean();
    parts.push(("z2", scalar(&square)));
    finish(&ae.graph, &(loss + square * batch.latent_penalty), parts)
}

/// L1 + 0.1·L1 of the image gradients of an error of frames whose values span −1 to 1; means are weighted by `emphasis`.
fn reconstruction(error: Tensor<4>, emphasis: Tensor<4>) -> (Tensor<1>, Vec<(&'static str, f32)>) {
    let [n, h, w, c] = error.dims();
    let part = |y: Range<usize>, x: Range<usize>| error.clone().slice([0..n, y, x, 0..c]);
    let weight = |y: Range<usize>, x: Range<usize>| emphasis.clone().slice([0..n, y, x, 0..1]);
    let across = weighted(part(0..h, 1..w) - part(0..h, 0..w - 1), Tensor::abs, weight(0..h, 1..w));
    let down = weighted(part(1..h, 0..w) - part(0..h - 1, 0..w), Tensor::abs, weight(1..h, 0..w));
    let absolute = weighted(error.clone(), Tensor::abs, emphasis);
    let mse = scalar(&error.powi_scalar(2).mean());
    // The peak-to-peak range is 2.
    let parts = vec![("l1", scalar(&absolute)), ("psnr_db", 10.0 * (4.0 / mse).log10())];
    (absolute + (across + down) * 0.1, parts)
}

/// Returns Σ w·f(x) / Σ w, with weights [.., 1] for values [.., channels].
fn weighted<const D: usize>(x: Tensor<D>, f: impl Fn(Tensor<D>) -> Tensor<D>, weight: Tensor<D>) -> Tensor<1> {
    (f(x) * weight.clone()).mean() / weight.mean()
}

/// A batch for the decoder alone.
pub struct DecoderBatch {
    /// Clips.
    pub clips: usize,
    /// Latents as the decoder takes them, [clips·steps, h, w, z].
    pub latents: Array,
    /// Layouts of the frames, −1 to 1, [clips·steps·stride_t, 8h, 8w, 3]; zeros where a clip's layout was dropped.
    pub layouts: Array,
    /// The frames, in the same shape.
    pub frames: Array,
    /// How much each pixel counts, [clips·steps·stride_t, 8h, 8w, 1].
    pub emphasis: Array,
}

/// Decoder step: the reconstruction loss, with gradients for the decoder's weights alone.
#[must_use]
pub fn decoder(shape: &AeShape, weights: &Weights, batch: &DecoderBatch) -> Step {
    let ae = TinyAe::bind(shape, weights, Mode::Train);
    let layouts = shape.guided.then(|| ae.graph.tensor(&batch.layouts));
    let frames = ae.decode_tensor(ae.graph.tensor(&batch.latents), layouts, batch.clips, &mut Memory::default());
    let emphasis = ae.graph.tensor(&batch.emphasis);
    let (loss, parts) = reconstruction(frames - ae.graph.tensor(&batch.frames), emphasis);
    let mut step = finish(&ae.graph, &loss, parts);
    for name in weights.iter().map(|(name, _)| name).filter(|name| name.starts_with("encoder.")) {
        step.gradient.remove(name);
    }
    step
}

/// Clips for the transformer.
pub struct ClipBatch {
    /// Clean latents [B, F, tokens, 4, z]; frame 0 is the given first frame.
    pub clean: Array,
    /// Space-to-depth layouts [B, F·tokens, 4, control inputs].
    pub layouts: Array,
    /// 1 where a clip shows its layout, 0 where it was dropped.
    pub layout_on: Vec<f32>,
    /// Prompt tokens [B, text_len, text_dim].
    pub text: Array,
    /// How much each latent pixel counts, [B, F, tokens, 4, 1].
    pub emphasis: Array,
}

/// A noise level: σ, and the timestep 1000·σ that labels it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level(pub f32);

/// How the causal student is trained: with the policy of its cache.
pub struct CausalPlan {
    /// Window, sink, chunk and positions, as at inference.
    pub cache: CachePolicy,
    /// The level of the frames that later chunks attend to.
    pub context: Level,
    /// Whether the context frames are a sampler step themselves and carry loss.
    pub context_trained: bool,
    /// The level of the query frames.
    pub query: Level,
    /// What the output stands for.
    pub prediction: Prediction,
    /// The frames that are also queried, within 1..F and aligned to chunks.
    pub queries: Range<usize>,
    /// Noise of the context frames, [B, F − 1, tokens, 4, z].
    pub context_noise: Array,
    /// Noise of the query frames, [B, queries, tokens, 4, z].
    pub query_noise: Array,
}

/// A group of query frames and the frames that it attends to, as indices into the sequence.
struct Group {
    queries: Range<usize>,
    sink: usize,
    evicted: usize,
    past: Range<usize>,
    own: Range<usize>,
}

/// The sequence [o_0 clean ++ context frames ++ query frames] and the network's output for it.
struct Sequence {
    context_clean: Tensor<5>,
    query_clean: Tensor<5>,
    context: Tensor<5>,
    query: Tensor<5>,
    output: Tensor<5>,
}

fn sequence(dit: &Dit, batch: &ClipBatch, plan: &CausalPlan) -> Sequence {
    let [b, frames, n, _, z]: [usize; 5] = batch.clean.shape().try_into().expect("clean latents have five axes");
    let part = |x: &Tensor<5>, range: Range<usize>| x.clone().slice([0..b, range, 0..n, 0..4, 0..z]);
    let mix = |clean: Tensor<5>, noise: Tensor<5>, level: Level| clean * (1.0 - level.0) + noise * level.0;
    let clean = dit.graph.tensor::<5>(&batch.clean);
    let (first, rest) = (part(&clean, 0..1), part(&clean, 1..frames));
    let context = mix(rest.clone(), dit.graph.tensor(&plan.context_noise), plan.context);
    let query_clean = part(&clean, plan.queries.clone());
    let query = mix(query_clean.clone(), dit.graph.tensor(&plan.query_noise), plan.query);
    let all = frames + plan.queries.len();
    let labels = |level: Level, count: usize| vec![1000.0 * level.0; count];
    let later = labels(plan.query, plan.queries.len());
    let times = [vec![0.0], labels(plan.context, frames - 1), later].concat().repeat(b);
    let control = control(dit, batch);
    let later = control.clone().slice([
        0..b,
        plan.queries.start * n..plan.queries.end * n,
        0..4,
        0..dit.shape.control_channels,
    ]);
    let start = start(dit, first.clone(), all);
    let noisy = Tensor::cat(vec![first, context.clone(), query.clone()], 1);
    let rows = [b, all * n, 4, z];
    let tokens = Tokens {
        noisy: noisy.reshape(rows),
        control: Tensor::cat(vec![control, later], 1),
        start: start.reshape(rows),
        times,
    };
    let prompt = dit.context(&batch.text, &first_frames(batch));
    let groups = groups(frames, plan);
    let positions: Vec<usize> = (0..frames).chain(plan.queries.clone()).collect();
    let output = dit.forward(tokens, &prompt, &mut |_, qkv| grouped(dit, &groups, &positions, qkv));
    Sequence { context_clean: rest, query_clean, context, query, output: output.reshape([b, all, n, 4, z]) }
}

/// Causal step. Context chunks see earlier context and themselves, query chunks see earlier context and themselves,
/// with the window, sink and positions of the cache. The loss is the mean square error of the predicted clean latent
/// over query frames and, if trained, context frames, weighted by the batch's emphasis.
#[must_use]
pub fn causal(shape: &DitShape, weights: &Weights, batch: &ClipBatch, plan: &CausalPlan) -> Step {
    let dit = Dit::bind(shape, weights, Mode::Train);
    let Sequence { context_clean, query_clean, context, query, output } = sequence(&dit, batch, plan);
    let [b, all, n, _, z] = output.dims();
    let frames = all - plan.queries.len();
    let part = |range: Range<usize>| output.clone().slice([0..b, range, 0..n, 0..4, 0..z]);
    let emphasis = dit.graph.tensor::<5>(&batch.emphasis);
    let error = |output: Tensor<5>, noisy: Tensor<5>, clean: Tensor<5>, level: Level, frames: Range<usize>| {
        let x0 = match plan.prediction {
            Prediction::Clean => output,
            Prediction::Flow => noisy - output * level.0,
        };
        let weight = emphasis.clone().slice([0..b, frames, 0..n, 0..4, 0..1]);
        weighted(x0 - clean, |error| error.powi_scalar(2), weight)
    };
    let query = error(part(frames..all), query, query_clean, plan.query, plan.queries.clone());
    let context = error(part(1..frames), context, context_clean, plan.context, 1..frames);
    let parts = vec![("query", scalar(&query)), ("context", scalar(&context))];
    let loss = if plan.context_trained { (query + context) * 0.5 } else { query };
    finish(&dit.graph, &loss, parts)
}

/// Runs the parallel causal form without gradients: the output for [o_0 ++ context ++ query] frames,
/// [B, F + queries, tokens, 4, z].
#[must_use]
pub fn causal_output(shape: &DitShape, weights: &Weights, batch: &ClipBatch, plan: &CausalPlan) -> Array {
    array_of(sequence(&Dit::bind(shape, weights, Mode::Infer), batch, plan).output)
}

fn first_frames(batch: &ClipBatch) -> Array {
    let shape = batch.clean.shape();
    let frame = shape[2..].iter().product::<usize>();
    let values = batch.clean.values().chunks(frame * shape[1]).flat_map(|clip| &clip[..frame]).copied().collect();
    Array::new(&[shape[0], shape[2], shape[3], shape[4]], values)
}

/// Returns the start latents of all frames, given the first frame's.
fn start(dit: &Dit, first: Tensor<5>, frames: usize) -> Tensor<5> {
    let [b, _, n, pixels, z] = first.dims();
    let rest = if dit.shape.start_every {
        first.clone().repeat_dim(1, frames - 1)
    } else {
        Tensor::zeros([b, frames - 1, n, pixels, z], &dit.graph.device)
    };
    Tensor::cat(vec![first, rest], 1)
}

fn control(dit: &Dit, batch: &ClipBatch) -> Tensor<4> {
    let control = dit.control(&batch.layouts).0;
    let on = dit.graph.tensor::<4>(&Array::new(&[batch.layout_on.len(), 1, 1, 1], batch.layout_on.clone()));
    control * on
}

/// Lists the attention groups: chunk by chunk, first as context, then as query.
fn groups(frames: usize, plan: &CausalPlan) -> Vec<Group> {
    let cache = &plan.cache;
    let mut list = vec![Group { queries: 0..1, sink: 0, evicted: 0, past: 0..0, own: 0..1 }];
    let chunks = |range: Range<usize>| range.step_by(cache.chunk);
    let moved = frames - plan.queries.start.min(frames);
    let starts = chunks(1..frames).map(|start| (start, 0)).chain(chunks(plan.queries.clone()).map(|s| (s, moved)));
    for (start, offset) in starts {
        let end = (start + cache.chunk).min(if offset == 0 { frames } else { plan.queries.end });
        let visible = Visible::of(start, cache.chunk, cache.window, cache.sink);
        let evicted = if cache.positions == Positions::CacheRelative { visible.evicted } else { 0 };
        let own = start + offset..end + offset;
        list.push(Group { queries: own.clone(), sink: visible.sink, evicted, past: visible.past, own });
    }
    list
}

fn grouped(dit: &Dit, groups: &[Group], positions: &[usize], qkv: Qkv) -> Tensor<3> {
    let (heads, n) = (dit.shape.heads(), dit.shape.tokens());
    let [b, _, d] = qkv.q.dims();
    let rotation = heads.rotation(&dit.graph, positions);
    let (q, k) = (rotation.apply(qkv.q), rotation.apply(qkv.k.clone()));
    let part = |x: &Tensor<3>, range: &Range<usize>| x.clone().slice([0..b, range.start * n..range.end * n, 0..d]);
    let attend = |group: &Group| {
        let sink = 0..group.sink;
        // Moving the sink forward by the evicted frames is the same as moving all others back.
        let sink_k = if group.evicted == 0 {
            part(&k, &sink)
        } else {
            let moved: Vec<usize> = sink.clone().map(|frame| frame + group.evicted).collect();
            heads.rotation(&dit.graph, &moved).apply(part(&qkv.k, &sink))
        };
        let ranges = [&group.past, &group.own];
        let mut ks = vec![];
        let mut vs = vec![];
        if group.sink > 0 {
            ks.push(sink_k);
            vs.push(part(&qkv.v, &sink));
        }
        for range in ranges.into_iter().filter(|range| !range.is_empty()) {
            ks.push(part(&k, range));
            vs.push(part(&qkv.v, range));
        }
        heads.attend(dit.graph.mode, part(&q, &group.queries), Tensor::cat(ks, 1), Tensor::cat(vs, 1))
    };
    Tensor::cat(groups.iter().map(attend).collect(), 1)
}

/// Bidirectional flow-matching step of the teacher: one level per clip, `noise` in the shape of the clean latents.
#[must_use]
pub fn bidirectional(shape: &DitShape, weights: &Weights, batch: &ClipBatch, levels: &[f32], noise: &Array) -> Step {
    let dit = Dit::bind(shape, weights, Mode::Train);
    let (clean, noise) = (dit.graph.tensor::<5>(&batch.clean), dit.graph.tensor::<5>(noise));
    let [b, frames, n, _, z] = clean.dims();
    let sigma = dit.graph.tensor::<5>(&Array::new(&[b, 1, 1, 1, 1], levels.to_vec()));
    let noisy = clean.clone() * (sigma.clone() * -1.0 + 1.0) + noise.clone() * sigma;
    let output = teacher_forward(&dit, batch, noisy, levels);
    let target = (noise - clean).reshape([b, frames * n, 4, z]);
    let weight = dit.graph.tensor::<5>(&batch.emphasis).reshape([b, frames * n, 4, 1]);
    let loss = weighted(output - target, |error| error.powi_scalar(2), weight);
    finish(&dit.graph, &loss, Vec::new())
}

fn teacher_forward(dit: &Dit, batch: &ClipBatch, noisy: Tensor<5>, levels: &[f32]) -> Tensor<4> {
    let [b, frames, n, _, z] = noisy.dims();
    let first = dit.graph.tensor::<4>(&first_frames(batch)).reshape([b, 1, n, 4, z]);
    let start = start(dit, first, frames);
    let times = levels.iter().flat_map(|level| vec![1000.0 * level; frames]).collect();
    let rows = [b, frames * n, 4, z];
    let tokens = Tokens { noisy: noisy.reshape(rows), control: control(dit, batch), start: start.reshape(rows), times };
    let heads = dit.shape.heads();
    let rotation = heads.rotation(&dit.graph, &(0..frames).collect::<Vec<_>>());
    let context = dit.context(&batch.text, &first_frames(batch));
    dit.forward(tokens, &context, &mut |_, Qkv { q, k, v }| {
        heads.attend(dit.graph.mode, rotation.apply(q), rotation.apply(k), v)
    })
}

/// Runs the teacher once without gradients: the flow of noisy latents [B, F, tokens, 4, z] at one level per clip.
#[must_use]
pub fn teacher_flow(shape: &DitShape, weights: &Weights, batch: &ClipBatch, noisy: &Array, levels: &[f32]) -> Array {
    let dit = Dit::bind(shape, weights, Mode::Infer);
    let flow = teacher_forward(&dit, batch, dit.graph.tensor(noisy), levels);
    Array::new(noisy.shape(), array_of(flow).into_values())
}

#[cfg(test)]
mod tests;

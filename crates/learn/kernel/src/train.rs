//! Training steps on the processor: the counterparts of `ds_graph::step::bidirectional`, `ds_graph::step::causal`,
//! `ds_graph::step::autoencoder` and `ds_graph::step::decoder`, forward and backward by hand instead of through the
//! framework's graph.
//!
//! A call works on one thread, clip by clip, in buffers that the next call takes over; a
//! [`Team`](ds_nn::team::Team) runs calls side by side. Sums over rows and clips have one order, so that results have
//! the same bits whatever the number of workers.

mod attention;
mod autoencoder;
mod backward;
mod convolution;
mod discriminator;
mod guide;
mod images;
mod linear;
mod matrix;
mod network;
mod pixels;
mod rows;
mod sequence;
mod time;

use std::ops::Range;
use std::sync::{Arc, LazyLock};

use ds_nn::array::{Array, Weights};
use ds_nn::dit::DitShape;
use ds_nn::step::{BidirectionalPlan, CausalPlan, ClipBatch, Group, Level, Prediction, SMALLEST_SIGMA, Step, groups};

use super::Buffer;
use super::buffer::Pool;
use backward::{Back, Backward};
pub use discriminator::adversarial;
use network::{Network, Tape};
pub use pixels::{autoencoder, decoder};
use sequence::Sequence;

/// Buffers of one call.
#[derive(Default)]
struct Scratch {
    tape: Tape,
    back: Back,
    d_output: Buffer,
}

/// Buffers wait here between calls: as many sets as calls ever ran at once.
static SPARE: LazyLock<Arc<Pool<Scratch>>> = LazyLock::new(Arc::default);

/// One clip of a batch with what it is conditioned on.
struct Clip<'a> {
    clean: &'a [f32],
    first: Vec<f32>,
    start: Vec<f32>,
    text: Vec<f32>,
    layouts: &'a [f32],
    layout_on: f32,
    emphasis: &'a [f32],
}

/// Returns an array's values of one clip.
fn of_clip(array: &Array, clip: usize, clips: usize) -> &[f32] {
    let size = array.values().len() / clips;
    &array.values()[clip * size..(clip + 1) * size]
}

impl<'a> Clip<'a> {
    fn of(batch: &'a ClipBatch, at: usize, frame: usize) -> Self {
        let clips = batch.clean.shape()[0];
        let given = |values: &[f32]| values.iter().map(|value| value * batch.given_on[at]).collect();
        let clean = of_clip(&batch.clean, at, clips);
        Self {
            clean,
            first: given(&clean[..frame]),
            start: given(of_clip(&batch.start, at, clips)),
            text: given(of_clip(&batch.text, at, clips)),
            layouts: of_clip(&batch.layouts, at, clips),
            layout_on: batch.layout_on[at],
            emphasis: of_clip(&batch.emphasis, at, clips),
        }
    }

    fn noisy(&self, parts: &[&[f32]]) -> Vec<f32> {
        std::iter::once(&*self.first).chain(parts.iter().copied()).flatten().copied().collect()
    }
}

/// A mean square error weighted by emphasis, and its gradient.
struct Loss {
    sum: f64,
    /// z times the sum of all weights.
    count: f64,
}

impl Loss {
    /// Prepares the loss over frames of every clip.
    fn over(batch: &ClipBatch, frames: &Range<usize>, z: usize) -> Self {
        let clips = batch.clean.shape()[0];
        let per_frame = batch.emphasis.values().len() / clips / batch.clean.shape()[1];
        let part = |clip| &of_clip(&batch.emphasis, clip, clips)[frames.start * per_frame..frames.end * per_frame];
        let count: f64 = (0..clips).flat_map(part).map(|weight| f64::from(*weight)).sum();
        Self { sum: 0.0, count: count * z as f64 }
    }

    /// Adds errors of one clip weighted by pixel, and turns them into gradients times a factor.
    #[expect(clippy::cast_possible_truncation, reason = "gradients are single precision")]
    fn add(&mut self, errors: &mut [f32], weights: &[f32], z: usize, factor: f32) {
        let factor = 2.0 * f64::from(factor) / self.count;
        for (errors, weight) in errors.chunks_exact_mut(z).zip(weights) {
            for error in errors {
                let weighted = f64::from(*error) * f64::from(*weight);
                self.sum += weighted * f64::from(*error);
                *error = (weighted * factor) as f32;
            }
        }
    }

    #[expect(clippy::cast_possible_truncation, reason = "losses are single precision")]
    fn value(&self) -> f32 {
        (self.sum / self.count) as f32
    }
}

/// Computes a flow-matching step: equal to `ds_graph::step::bidirectional`.
///
/// # Panics
/// If the shape is not one of the project's own networks.
#[must_use]
pub fn bidirectional(shape: &DitShape, weights: &Weights, batch: &ClipBatch, plan: &BidirectionalPlan) -> Step {
    let [clips, frames, tokens, _, z]: [usize; 5] =
        batch.clean.shape().try_into().expect("clean latents have five axes");
    let (network, frame) = (Network::new(shape, weights), tokens * 4 * z);
    let mut scratch = SPARE.take(Scratch::default);
    let Scratch { tape, back, d_output } = &mut *scratch;
    let mut gradient = weights.zeros_like();
    let mut loss = Loss::over(batch, &(1..frames), z);
    for at in 0..clips {
        let (clip, sigma) = (Clip::of(batch, at, frame), plan.levels[at]);
        let (clean, noise) = (&clip.clean[frame..], of_clip(&plan.noise, at, clips));
        let noisy: Vec<f32> = clean.iter().zip(noise).map(|(x, noise)| x * (1.0 - sigma) + noise * sigma).collect();
        let whole = Group { queries: 0..frames, sink: 0, evicted: 0, past: 0..0, own: 0..frames };
        let sequence = Sequence {
            noisy: clip.noisy(&[&noisy]),
            layouts: clip.layouts,
            layout_on: clip.layout_on,
            times: std::iter::once(0.0).chain(std::iter::repeat_n(1000.0 * sigma, frames - 1)).collect(),
            positions: (0..frames).collect(),
            groups: vec![whole],
            detached: false,
            live: 0,
            start: clip.start,
            text: clip.text,
        };
        network.forward(&sequence, tape);
        let d_output = d_output.sized(frames * frame);
        d_output[..frame].fill(0.0);
        let scale = match plan.prediction {
            Prediction::Flow => 1.0,
            Prediction::Clean => 1.0 / sigma.max(SMALLEST_SIGMA),
        };
        let pairs = tape.output[frame..].iter().zip(clean.iter().zip(noise));
        for (error, (output, (clean, noise))) in d_output[frame..].iter_mut().zip(pairs) {
            let target = if plan.prediction == Prediction::Flow { noise - clean } else { *clean };
            *error = (output - target) * scale;
        }
        loss.add(&mut d_output[frame..], &clip.emphasis[tokens * 4..], z, scale);
        Backward { network: &network, sequence: &sequence, tape, back, gradient: &mut gradient }.run(d_output);
    }
    Step { loss: loss.value(), parts: Vec::new(), gradient }
}

/// One of the two losses of a causal step.
struct Part<'a> {
    name: &'static str,
    /// Where its frames lie in the sequence.
    frames: Range<usize>,
    /// Which frames of the clip they are.
    positions: Range<usize>,
    states: &'a Array,
    level: Level,
    loss: Loss,
}

/// Computes a causal step: equal to `ds_graph::step::causal`.
///
/// # Panics
/// If the shape is not one of the project's own networks, or nothing carries loss.
#[must_use]
pub fn causal(shape: &DitShape, weights: &Weights, batch: &ClipBatch, plan: &CausalPlan) -> Step {
    let [clips, frames, tokens, _, z]: [usize; 5] =
        batch.clean.shape().try_into().expect("clean latents have five axes");
    let (network, frame, all) = (Network::new(shape, weights), tokens * 4 * z, frames + plan.queries.len());
    let mut parts = causal_parts(batch, plan);
    let share = 1.0 / parts.len() as f32;
    let live = match (plan.context_detached, plan.context_trained) {
        (true, true) => 1,
        (true, false) => frames,
        _ => 0,
    };
    let mut scratch = SPARE.take(Scratch::default);
    let Scratch { tape, back, d_output } = &mut *scratch;
    let mut gradient = weights.zeros_like();
    for at in 0..clips {
        let clip = Clip::of(batch, at, frame);
        let label = |level: Level, count: usize| std::iter::repeat_n(1000.0 * level.0, count);
        let later = label(plan.query_level, plan.queries.len());
        let sequence = Sequence {
            noisy: clip.noisy(&[of_clip(&plan.context, at, clips), of_clip(&plan.query, at, clips)]),
            layouts: clip.layouts,
            layout_on: clip.layout_on,
            times: std::iter::once(0.0).chain(label(plan.context_level, frames - 1)).chain(later).collect(),
            positions: (0..frames).chain(plan.queries.clone()).collect(),
            groups: groups(frames, plan),
            detached: plan.context_detached,
            live,
            start: clip.start,
            text: clip.text,
        };
        network.forward(&sequence, tape);
        let d_output = d_output.sized((all - live) * frame);
        d_output.fill(0.0);
        for part in &mut parts {
            let errors = &mut d_output[(part.frames.start - live) * frame..(part.frames.end - live) * frame];
            let outputs = &tape.output[part.frames.start * frame..part.frames.end * frame];
            let target = &of_clip(&plan.target, at, clips)[(part.positions.start - 1) * frame..];
            let inputs = outputs.iter().zip(of_clip(part.states, at, clips)).zip(target);
            for (error, ((output, noisy), target)) in errors.iter_mut().zip(inputs) {
                *error = match plan.prediction {
                    Prediction::Clean => output - target,
                    Prediction::Flow => noisy - output * part.level.0 - target,
                };
            }
            let factor = if plan.prediction == Prediction::Flow { -part.level.0 * share } else { share };
            part.loss.add(errors, &clip.emphasis[part.positions.start * tokens * 4..], z, factor);
        }
        Backward { network: &network, sequence: &sequence, tape, back, gradient: &mut gradient }.run(d_output);
    }
    let parts: Vec<_> = parts.iter().map(|part| (part.name, part.loss.value())).collect();
    Step { loss: parts.iter().map(|(_, loss)| loss).sum::<f32>() * share, parts, gradient }
}

/// Lists the losses of a causal step.
///
/// # Panics
/// If there is none.
fn causal_parts<'a>(batch: &ClipBatch, plan: &'a CausalPlan) -> Vec<Part<'a>> {
    let (frames, z) = (batch.clean.shape()[1], batch.clean.shape()[4]);
    let mut parts = Vec::new();
    if !plan.queries.is_empty() {
        parts.push(Part {
            name: "query",
            frames: frames..frames + plan.queries.len(),
            positions: plan.queries.clone(),
            states: &plan.query,
            level: plan.query_level,
            loss: Loss::over(batch, &plan.queries, z),
        });
    }
    if plan.context_trained {
        parts.push(Part {
            name: "context",
            frames: 1..frames,
            positions: 1..frames,
            states: &plan.context,
            level: plan.context_level,
            loss: Loss::over(batch, &(1..frames), z),
        });
    }
    assert!(!parts.is_empty(), "a causal step has queries or a trained context");
    parts
}

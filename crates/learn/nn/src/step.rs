//! What one training step of each network takes and gives: batches, levels, plans, and the loss with its gradients.
//!
//! Convention: x_t = (1 − σ)·x0 + σ·ε, t = 1000·σ, flow v = ε − x0. Batches hold normalised latents as tokens
//! [B, frames, tokens, 4, z]; frame 0 is the given first frame o_0, always clean at t = 0 and never part of a loss.
//! All noise is drawn by the caller. A step of many clips is the mean of steps of few ([`Step::mean`]), which a
//! [`Team`](crate::team::Team) computes side by side. The bodies compute the steps.

use std::ops::Range;

use crate::array::{Array, Weights};
use crate::cache::{CachePolicy, Positions, Visible};
use crate::discriminator::DiscriminatorShape;

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
        let count = steps.len();
        let mut steps = steps.into_iter();
        let mut sum = steps.next().expect("a batch has at least one clip");
        steps.for_each(|step| sum.gather(&step));
        sum.over(count)
    }

    /// Adds another step of as many clips: its loss, the parts of the loss, and the gradient.
    pub fn gather(&mut self, step: &Self) {
        self.parts.iter_mut().zip(&step.parts).for_each(|((_, sum), (_, value))| *sum += value);
        self.add(step);
    }

    /// Returns the mean of so many gathered steps.
    #[must_use]
    pub fn over(self, count: usize) -> Self {
        #[expect(clippy::cast_precision_loss, reason = "a batch has few parts")]
        let share = 1.0 / count as f32;
        self.shared(share)
    }

    /// Returns the share of the step that its clips have in a batch.
    #[must_use]
    pub fn shared(mut self, share: f32) -> Self {
        self.parts.iter_mut().for_each(|(_, value)| *value *= share);
        self.scaled(share)
    }

    /// Adds loss and gradient of another step; the parts of the loss stay.
    pub fn add(&mut self, step: &Self) {
        self.loss += step.loss;
        for ((_, sum), (_, array)) in self.gradient.iter_mut().zip(step.gradient.iter()) {
            sum.values_mut().iter_mut().zip(array.values()).for_each(|(sum, value)| *sum += value);
        }
    }

    /// Returns the step of the loss times a factor; its parts stay.
    #[must_use]
    pub fn scaled(mut self, factor: f32) -> Self {
        self.loss *= factor;
        self.gradient.iter_mut().for_each(|(_, array)| array.values_mut().iter_mut().for_each(|x| *x *= factor));
        self
    }
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

/// Clips and what one step asks of them, that can be computed beside others as one.
pub trait Joins: Sized {
    /// Says whether another can be joined to it.
    fn joins(&self, other: &Self) -> bool;

    /// Joins several; the step of all is the mean of their steps.
    fn joined(parts: &[Self]) -> Self;
}

impl ClipBatch {
    /// Joins clips of one length. Emphasis is brought to a mean of 1 over the frames of each clip that are not given, so
    /// that each clip counts alike.
    ///
    /// # Panics
    /// If there are none, or their lengths differ.
    #[must_use]
    pub fn joined<'a>(clips: impl Iterator<Item = &'a Self> + Clone) -> Self {
        let emphasis: Vec<Array> = clips.clone().map(|clip| level(&clip.emphasis)).collect();
        let all = |array: fn(&'a Self) -> &'a Array| Array::joined(clips.clone().map(array));
        Self {
            clean: all(|clip| &clip.clean),
            start: all(|clip| &clip.start),
            layouts: all(|clip| &clip.layouts),
            layout_on: clips.clone().flat_map(|clip| clip.layout_on.iter().copied()).collect(),
            given_on: clips.clone().flat_map(|clip| clip.given_on.iter().copied()).collect(),
            text: all(|clip| &clip.text),
            emphasis: Array::joined(&emphasis),
        }
    }
}

/// Divides the emphasis of one clip by its mean over frames 1..F.
fn level(emphasis: &Array) -> Array {
    let frame = emphasis.values().len() / emphasis.shape()[1];
    let later = &emphasis.values()[frame..];
    #[expect(clippy::cast_precision_loss, reason = "a mean over a clip")]
    let mean = later.iter().sum::<f32>() / later.len().max(1) as f32;
    Array::new(emphasis.shape(), emphasis.values().iter().map(|value| value / mean).collect())
}

impl Joins for (ClipBatch, BidirectionalPlan) {
    fn joins(&self, other: &Self) -> bool {
        self.0.clean.shape() == other.0.clean.shape() && self.1.prediction == other.1.prediction
    }

    fn joined(parts: &[Self]) -> Self {
        let plan = BidirectionalPlan {
            levels: parts.iter().flat_map(|(_, plan)| plan.levels.iter().copied()).collect(),
            noise: Array::joined(parts.iter().map(|(_, plan)| &plan.noise)),
            prediction: parts[0].1.prediction,
        };
        (ClipBatch::joined(parts.iter().map(|(batch, _)| batch)), plan)
    }
}

impl Joins for (ClipBatch, CausalPlan) {
    fn joins(&self, (batch, other): &Self) -> bool {
        let plan = &self.1;
        self.0.clean.shape() == batch.clean.shape()
            && plan.cache == other.cache
            && (plan.context_trained, plan.context_detached) == (other.context_trained, other.context_detached)
            && (plan.context_level, plan.query_level) == (other.context_level, other.query_level)
            && (&plan.queries, plan.prediction) == (&other.queries, other.prediction)
    }

    fn joined(parts: &[Self]) -> Self {
        let all = |array: fn(&CausalPlan) -> &Array| Array::joined(parts.iter().map(|(_, plan)| array(plan)));
        let plan = CausalPlan {
            context: all(|plan| &plan.context),
            query: all(|plan| &plan.query),
            target: all(|plan| &plan.target),
            ..parts[0].1.clone()
        };
        (ClipBatch::joined(parts.iter().map(|(batch, _)| batch)), plan)
    }
}

/// A noise level: σ, and the timestep 1000·σ that labels it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level(pub f32);

/// Levels below count as this one where the flow is derived from a clean latent.
pub const SMALLEST_SIGMA: f32 = 0.1;

/// Levels and noise of a bidirectional step.
#[derive(Debug, Clone)]
pub struct BidirectionalPlan {
    /// σ of each clip.
    pub levels: Vec<f32>,
    /// Noise of frames 1..F, [B, F − 1, tokens, 4, z].
    pub noise: Array,
    /// What the output stands for.
    pub prediction: Prediction,
}

/// States, levels and targets of a causal step.
#[derive(Debug, Clone)]
pub struct CausalPlan {
    /// Window, sink, chunk and positions, as at inference.
    pub cache: CachePolicy,
    /// Frames 1..F as later chunks see them, [B, F − 1, tokens, 4, z].
    pub context: Array,
    /// The level of the context frames.
    pub context_level: Level,
    /// Whether the context frames are a sampler step themselves and carry loss.
    pub context_trained: bool,
    /// Whether gradients stop at the keys and values of earlier chunks, as those of a cache do.
    pub context_detached: bool,
    /// The frames that are also queried, within 1..F and aligned to chunks.
    pub queries: Range<usize>,
    /// The query frames, [B, queries, tokens, 4, z].
    pub query: Array,
    /// The level of the query frames.
    pub query_level: Level,
    /// The clean latents that the outputs should give, [B, F − 1, tokens, 4, z].
    pub target: Array,
    /// What the output stands for.
    pub prediction: Prediction,
}

/// A group of query frames and the frames that it attends to, as indices into the sequence.
pub struct Group {
    /// The frames that attend.
    pub queries: Range<usize>,
    /// Number of sink frames, from frame 0.
    pub sink: usize,
    /// Frames that were dropped between sink and past; 0 where positions count from the start of the rollout.
    pub evicted: usize,
    /// Frames after the sink.
    pub past: Range<usize>,
    /// The frames of the group's own chunk.
    pub own: Range<usize>,
}

/// Lists the attention groups: chunk by chunk, first as context, then as query.
#[must_use]
pub fn groups(frames: usize, plan: &CausalPlan) -> Vec<Group> {
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

/// A batch for the decoder alone.
pub struct DecoderBatch {
    /// Clips.
    pub clips: usize,
    /// Latents as the decoder takes them, [clips·steps, h, w, z].
    pub latents: Array,
    /// What guides the frames, [clips·steps·stride_t, 8h, 8w, [`AeShape::guide_channels`](crate::tiny_ae::AeShape::guide_channels)],
    /// first the layout, −1 to 1; zeros where a clip's layout was dropped.
    pub guide: Array,
    /// The frames, −1 to 1, [clips·steps·stride_t, 8h, 8w, 3].
    pub frames: Array,
    /// Whether the latents are those of the frames, so that all of a frame can be told.
    pub told: bool,
    /// How much each pixel counts, [clips·steps·stride_t, 8h, 8w, 1].
    pub emphasis: Array,
    /// Weight of the error of what changes from frame to frame, beside that of the frames.
    pub change: f32,
    /// Weight of the error of how much neighbouring pixels differ on average within each block of 8×8, beside that of the frames.
    pub texture: f32,
}

/// What a decoder is trained against.
pub struct Adversary<'a> {
    /// Sizes of the discriminator.
    pub shape: DiscriminatorShape,
    /// Its weights.
    pub weights: &'a Weights,
    /// Noise around true frames within which its verdict is to stay, in the shape of the frames.
    pub noise: Array,
    /// Weight of the square of what that noise changes.
    pub smoothness: f32,
    /// Size of the adversarial gradient in units of the reconstruction's, at the frames.
    pub share: f32,
    /// Weight of the distance of features beside the verdict.
    pub features: f32,
    /// The share of its gradient's colour that reaches pixels which count less than 1; their brightness gets all of it.
    pub colour: f32,
}

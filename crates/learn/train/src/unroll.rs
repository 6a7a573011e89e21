//! Rollouts of the student in latents, as inference makes them, for training: what was cached, what was denoised.
//!
//! The network, cache and sampler of [`ds_video::Rollout`], without frames. Chunks exit at a given step: later
//! steps are left out, as Self Forcing does (video-model.md 3.4).

use ds_nn::Array;
use ds_nn::body::{Context, Transformer};
use ds_nn::cache::KvCache;
use ds_nn::step::ClipBatch;
use ds_space::Digest;
use ds_video::ModelConfig;
use ds_video::sampling::{Sampled, Sampling};

use crate::condition::noise;

/// A rollout over one clip; all [1, F − 1, tokens, 4, z].
pub(crate) struct Unrolled {
    /// What later chunks attended to.
    pub(crate) context: Array,
    /// The state that entered the exit step.
    pub(crate) query: Array,
    /// The clean latent that the exit step gave.
    pub(crate) clean: Array,
}

/// Rolls the student out over the layouts of one clip from its frame 0; chunks leave at step `exit`, from 1.
pub(crate) fn unroll(
    model: &ModelConfig,
    dit: &dyn Transformer,
    clip: &ClipBatch,
    seed: &Digest,
    exit: usize,
) -> Unrolled {
    let [_, frames, n, _, z]: [usize; 5] = clip.clean.shape().try_into().expect("clean latents have five axes");
    let context = dit.context(&clip.text, &clip.start);
    let cache = KvCache::new(model.cache());
    let mut roll = Roll { model, dit, clip, cache, context: &context, seed };
    let frame = n * 4 * z;
    let first = Array::new(&[1, n, 4, z], clip.clean.values()[..frame].to_vec());
    let kv = roll.sampled(0, 1, |sampling| sampling.pass(&first, 0.0)).1;
    roll.cache.commit(&kv);
    let (mut cached, mut query, mut clean) = (Vec::new(), Vec::new(), Vec::new());
    let mut at = 1;
    while at < frames {
        let count = model.causal.chunk.min(frames - at);
        let made = roll.chunk(at, count, exit);
        roll.cache.commit(&made.pass.1);
        cached.extend(made.cached.into_values());
        query.extend(made.entered.into_values());
        clean.extend(made.clean.into_values());
        at += count;
    }
    let shape = [1, frames - 1, n, 4, z];
    let array = |values| Array::new(&shape, values);
    Unrolled { context: array(cached), query: array(query), clean: array(clean) }
}

struct Roll<'a> {
    model: &'a ModelConfig,
    dit: &'a dyn Transformer,
    clip: &'a ClipBatch,
    cache: KvCache,
    context: &'a Context,
    seed: &'a Digest,
}

impl Roll<'_> {
    fn chunk(&self, at: usize, count: usize, exit: usize) -> Sampled {
        let shape = [count, self.model.dit().tokens(), 4, self.model.vae.z];
        let drawn = |step: usize| noise(self.seed, "rollout", &[at as u64, step as u64], &shape);
        self.sampled(at, count, |sampling| sampling.chunk(exit, drawn))
    }

    /// Gathers what all passes over `count` frames from frame `at` share.
    fn sampled<T>(&self, at: usize, count: usize, make: impl FnOnce(Sampling<'_>) -> T) -> T {
        let [_, _, n, _, z]: [usize; 5] = self.clip.clean.shape().try_into().expect("clean latents have five axes");
        let inputs = self.clip.layouts.shape()[3];
        let row = n * 4 * inputs;
        let layouts = self.clip.layouts.values()[at * row..(at + count) * row].to_vec();
        let shape = [count, n, 4, z];
        let start = if self.model.dit().start_every || at == 0 {
            Array::new(&shape, self.clip.start.values().repeat(count))
        } else {
            Array::zeros(&shape)
        };
        let control = self.dit.control(&Array::new(&[1, count * n, 4, inputs], layouts));
        let window = self.cache.window(self.dit, count);
        let (config, dit, context) = (self.model, self.dit, self.context);
        make(Sampling { config, dit, start: &start, control: &control, window: &window, context })
    }
}

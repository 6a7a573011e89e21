//! Rollouts of the student in latents, as inference makes them, for training: what was cached, what was denoised.
//!
//! The same network, cache and sampler as [`ds_video::Rollout`], without frames. Chunks exit at a given step: later
//! steps are left out, as Self Forcing does (video-model.md 3.4).

use ds_nn::Array;
use ds_nn::body::{Chunk, Context, Control, Transformer};
use ds_nn::cache::{ChunkKv, KvCache, Window};
use ds_nn::step::{ClipBatch, Prediction};
use ds_space::Digest;
use ds_video::{CacheSource, ModelConfig, sampler};

use crate::sets::noise;

/// A rollout over one clip; all [1, F − 1, tokens, 4, z].
pub(crate) struct Unrolled {
    /// What later chunks attended to.
    pub(crate) context: Array,
    /// The state that entered the exit step.
    pub(crate) query: Array,
    /// The clean latent that the exit step gave.
    pub(crate) clean: Array,
}

/// Returns the level of what the cache keeps.
pub(crate) fn context_level(model: &ModelConfig) -> f32 {
    let sigmas = sampler::sigmas(model.sampler.steps, model.sampler.shift);
    match model.cache_source() {
        CacheSource::State(at) => sigmas[at - 1],
        #[expect(clippy::cast_possible_truncation, reason = "levels are single precision")]
        CacheSource::Renoise(sigma) => sigma as f32,
        CacheSource::Clean | CacheSource::X0Hat(_) => 0.0,
    }
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
    let sigmas = sampler::sigmas(model.sampler.steps, model.sampler.shift);
    let mut roll = Roll { model, dit, clip, sigmas, cache: KvCache::new(model.cache()), context: &context, seed };
    let frame = n * 4 * z;
    let first = Array::new(&[1, n, 4, z], clip.clean.values()[..frame].to_vec());
    let kv = roll.run(&roll.given(0, 1), &first, 0.0).1;
    roll.cache.commit(&kv);
    let (mut cached, mut query, mut clean) = (Vec::new(), Vec::new(), Vec::new());
    let mut at = 1;
    while at < frames {
        let count = model.causal.chunk.min(frames - at);
        let made = roll.chunk(at, count, exit);
        roll.cache.commit(&made.kv);
        cached.extend(made.cached.into_values());
        query.extend(made.query.into_values());
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
    sigmas: Vec<f32>,
    cache: KvCache,
    context: &'a Context,
    seed: &'a Digest,
}

/// What all passes over a chunk share: the control latent, the start latent and the cached window.
struct Given {
    control: Control,
    start: Array,
    window: Window,
}

struct Made {
    kv: ChunkKv,
    cached: Array,
    query: Array,
    clean: Array,
}

impl Roll<'_> {
    fn chunk(&self, at: usize, count: usize, exit: usize) -> Made {
        let [_, _, n, _, z]: [usize; 5] = self.clip.clean.shape().try_into().expect("clean latents have five axes");
        let shape = [count, n, 4, z];
        let drawn = |step: usize| noise(self.seed, "rollout", &[at as u64, step as u64], &shape);
        let (source, given) = (self.model.cache_source(), self.given(at, count));
        let mut state = drawn(1);
        let (mut kept, mut query, mut clean) = (None, Array::default(), Array::default());
        for step in 1..=exit {
            let sigma = self.sigmas[step - 1];
            let (output, kv) = self.run(&given, &state, sigma);
            clean = match self.model.prediction() {
                Prediction::Clean => output,
                Prediction::Flow => {
                    let pairs = state.values().iter().zip(output.values());
                    Array::new(&shape, pairs.map(|(x, v)| x - sigma * v).collect())
                }
            };
            match source {
                CacheSource::State(kept_step) if kept_step == step => kept = Some((state.clone(), kv)),
                CacheSource::X0Hat(kept_step) if kept_step == step => {
                    kept = Some(self.write(&given, clean.clone(), 0.0))
                }
                _ => {}
            }
            if step == exit {
                query = state.clone();
            }
            if let Some(next) = self.sigmas.get(step) {
                state = sampler::noised(&clean, &drawn(step + 1), *next);
            }
        }
        let (cached, kv) = kept.unwrap_or_else(|| match source {
            CacheSource::State(step) => {
                let sigma = self.sigmas[step - 1];
                let state = sampler::noised(&clean, &drawn(step), sigma);
                self.write(&given, state, sigma)
            }
            CacheSource::Renoise(_) => {
                let sigma = context_level(self.model);
                let state = sampler::noised(&clean, &drawn(self.sigmas.len() + 1), sigma);
                self.write(&given, state, sigma)
            }
            CacheSource::Clean | CacheSource::X0Hat(_) => self.write(&given, clean.clone(), 0.0),
        });
        Made { kv, cached, query, clean }
    }

    /// Computes what all passes over `count` frames from frame `at` share.
    fn given(&self, at: usize, count: usize) -> Given {
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
        Given {
            control: self.dit.control(&Array::new(&[1, count * n, 4, inputs], layouts)),
            start,
            window: self.cache.window(self.dit, count),
        }
    }

    fn write(&self, given: &Given, state: Array, sigma: f32) -> (Array, ChunkKv) {
        let kv = self.run(given, &state, sigma).1;
        (state, kv)
    }

    /// Runs the network over the frames of a chunk.
    fn run(&self, given: &Given, noisy: &Array, sigma: f32) -> (Array, ChunkKv) {
        let Given { control, start, window } = given;
        let chunk = Chunk { noisy, start, control, time: 1000.0 * sigma };
        self.dit.denoise(&chunk, window, self.context)
    }
}

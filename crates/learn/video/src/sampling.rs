//! How a chunk is denoised in few steps, and what the cache keeps of it (video-model.md 2.4).

use ds_nn::Array;
use ds_nn::body::{Chunk, ChunkKv, Context, Control, Transformer, Window};
use ds_nn::step::Prediction;

use crate::config::{CacheSource, ModelConfig};
use crate::sampler;

/// What all passes over a chunk share.
pub struct Sampling<'a> {
    /// The model's configuration.
    pub config: &'a ModelConfig,
    /// The network.
    pub dit: &'a dyn Transformer,
    /// Start latents [frames, tokens, 4, z].
    pub start: &'a Array,
    /// The control latent.
    pub control: &'a Control,
    /// What is cached.
    pub window: &'a Window,
    /// Prompt and first frame.
    pub context: &'a Context,
}

/// A chunk as made; all states [frames, tokens, 4, z].
pub struct Sampled {
    /// The state that entered the last step made.
    pub entered: Array,
    /// The clean latent that this step gave.
    pub clean: Array,
    /// What is cached.
    pub cached: Array,
    /// Output of the pass that gave what is cached, and its keys and values.
    pub pass: (Array, ChunkKv),
}

/// Returns the level of what the cache keeps.
#[must_use]
pub fn cache_level(config: &ModelConfig) -> f32 {
    match config.cache_source() {
        CacheSource::Clean | CacheSource::X0Hat(_) => 0.0,
        #[expect(clippy::cast_possible_truncation, reason = "levels are single precision")]
        CacheSource::Renoise(sigma) => sigma as f32,
        CacheSource::State(step) => sampler::sigmas(config.sampler.steps, config.sampler.shift)[step - 1],
    }
}

impl Sampling<'_> {
    /// Denoises from pure noise and leaves after step `exit`, from 1; `noise` is what enters a step. Where the step that
    /// the cache takes its state from is not reached, the clean latent is brought to its level.
    pub fn chunk(&self, exit: usize, noise: impl Fn(usize) -> Array) -> Sampled {
        let config = self.config;
        let sigmas = sampler::sigmas(config.sampler.steps, config.sampler.shift);
        let source = config.cache_source();
        let (mut state, mut entered, mut clean) = (noise(1), Array::default(), Array::default());
        let (mut cached, mut pass) = (None, None);
        for (step, sigma) in (1..=exit).zip(&sigmas) {
            let (output, kv) = self.pass(&state, *sigma);
            clean = match config.prediction() {
                Prediction::Clean => output.clone(),
                Prediction::Flow => subtract(&state, &output, *sigma),
            };
            match source {
                CacheSource::State(at) if at == step => (cached, pass) = (Some(state.clone()), Some((output, kv))),
                CacheSource::X0Hat(at) if at == step => cached = Some(clean.clone()),
                _ => {}
            }
            entered = state;
            state = match sigmas.get(step) {
                Some(next) if step < exit => sampler::noised(&clean, &noise(step + 1), *next),
                _ => Array::default(),
            };
        }
        let cached = cached.unwrap_or_else(|| match source {
            CacheSource::State(step) => sampler::noised(&clean, &noise(step), cache_level(config)),
            CacheSource::Renoise(_) => sampler::noised(&clean, &noise(sigmas.len() + 1), cache_level(config)),
            CacheSource::Clean | CacheSource::X0Hat(_) => clean.clone(),
        });
        let pass = pass.unwrap_or_else(|| self.pass(&cached, cache_level(config)));
        Sampled { entered, clean, cached, pass }
    }

    /// Runs the network over the frames of the chunk at a level.
    #[must_use]
    pub fn pass(&self, noisy: &Array, sigma: f32) -> (Array, ChunkKv) {
        let chunk = Chunk { noisy, start: self.start, control: self.control, time: 1000.0 * sigma };
        self.dit.denoise(&chunk, self.window, self.context)
    }
}

/// Returns x − σ·v.
fn subtract(x: &Array, v: &Array, sigma: f32) -> Array {
    Array::new(x.shape(), x.values().iter().zip(v.values()).map(|(x, v)| x - sigma * v).collect())
}

//! One denoising step of a chunk behind a full window, by itself: what benchmarks and evaluations time.

use std::sync::Arc;

use ds_nn::Array;
use ds_nn::body::{Chunk, Context, Control, Window};
use ds_nn::cache::KvCache;
use ds_space::Digest;

use crate::{VideoModel, prompt, sampler};

/// Label of the measured step.
const TIME: f32 = 833.0;

/// A chunk of noise and all that it is denoised with.
pub struct Denoising {
    model: Arc<VideoModel>,
    noisy: Array,
    control: Control,
    context: Context,
    window: Window,
}

impl Denoising {
    /// Fills a window with chunks of noise.
    #[must_use]
    pub fn new(model: &Arc<VideoModel>) -> Self {
        let (config, dit) = (model.config(), model.transformer());
        let (shape, chunk) = (config.dit(), config.causal.chunk);
        let (tokens, z) = (shape.tokens(), config.vae.z);
        let control = dit.control(&Array::zeros(&[1, chunk * tokens, 4, shape.control_inputs]));
        let noisy = sampler::noise(&Digest::of(b"denoising"), "front", 1, 1, &[chunk, tokens, 4, z]);
        let first = Array::new(&[1, tokens, 4, z], noisy.values()[..tokens * 4 * z].to_vec());
        let context = dit.context(&prompt::hashed("a road", shape.text_len, shape.text_dim), &first);
        let mut cache = KvCache::new(config.cache());
        let step = |window: &Window| {
            let chunk = Chunk { noisy: &noisy, start: &noisy, control: &control, time: TIME };
            dit.denoise(&chunk, window, &context).1
        };
        let kv = step(&cache.window(dit, chunk));
        while cache.written() < config.causal.window {
            cache.commit(&kv);
        }
        let window = cache.window(dit, chunk);
        Self { model: Arc::clone(model), noisy, control, context, window }
    }

    /// Returns the floating-point operations of a step.
    #[must_use]
    pub fn operations(&self) -> f64 {
        let causal = &self.model.config().causal;
        self.model.transformer().operations(causal.chunk, causal.window - causal.chunk)
    }

    /// Denoises once.
    pub fn run(&self) -> Array {
        let chunk = Chunk { noisy: &self.noisy, start: &self.noisy, control: &self.control, time: TIME };
        self.model.transformer().denoise(&chunk, &self.window, &self.context).0
    }
}

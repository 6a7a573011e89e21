//! The work of a worker on a published configuration with drawn weights, part by part: what a measurement times.
//!
//! A chunk is denoised with a full window, steps and cache as configured; its latents are decoded; where the layout
//! goes through the autoencoder, a chunk of layouts is encoded. Values mean nothing, sizes and order are those of a
//! drive. No clock here.

use ds_graph::published::tae;
use ds_graph::published::wan_vae::WanVaeShape;
use ds_graph::{Product, device};
use ds_nn::Array;
use ds_nn::body::{Chunk, ChunkKv, Context, Control};
use ds_nn::cache::KvCache;
use ds_nn::work;
use ds_raster::RgbImage;
use ds_space::{Digest, Draws};

use crate::backend::Backend;
use crate::codec::{DecoderMemory, LayoutMemory};
use crate::config::{CacheSource, ModelConfig};
use crate::error::VideoError;
use crate::model::VideoModel;
use crate::{sampler, tokens};

/// Floating-point operations of a chunk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Operations {
    /// All forward passes of the transformer.
    pub denoise: f64,
    /// Decoding.
    pub decode: f64,
    /// Encoding the layouts; 0 where there is no such path.
    pub encode: f64,
}

/// A model of drawn weights with a full cache, past its first frame.
pub struct Workload {
    model: VideoModel,
    context: Context,
    cache: KvCache,
    decoder: DecoderMemory,
    layouts: LayoutMemory,
    clean: Array,
    chunk: u32,
}

fn drawn(name: &str, shape: &[usize]) -> Array {
    sampler::noise(&Draws::key(&Digest::of(b"workload"), "day", 0), name, 0, 1, shape)
}

impl Workload {
    /// Draws weights and fills the cache.
    ///
    /// # Errors
    /// As [`VideoModel::drawn`].
    ///
    /// # Panics
    /// If the configuration is not of a published model.
    pub fn new(backend: Backend, config: &ModelConfig) -> Result<Self, VideoError> {
        let model = VideoModel::drawn(backend, config)?;
        let frame = RgbImage::filled(config.video.width_px, config.video.height_px, [128; 3]);
        let (first, _) = model.codec.encode_first(config, &frame);
        let tokens = tokens::latents_to_tokens(&first);
        let context = model.conditions.context(&*model.dit, &config.model, "a prompt", &frame, &tokens)?;
        let clean = Array::zeros(&[config.causal.chunk, config.dit().tokens(), 4, config.vae.z]);
        let (cache, decoder) = (KvCache::new(config.cache()), DecoderMemory::default());
        let mut made = Self { model, context, cache, decoder, layouts: LayoutMemory::default(), clean, chunk: 0 };
        made.model.codec.decode(first, None, &mut made.decoder);
        made.control(1);
        made.fill();
        Ok(made)
    }

    /// Caches one chunk's keys and values until the window is full.
    fn fill(&mut self) {
        let noisy = drawn("fill", self.clean.shape());
        let (_, kv) = self.forward(&noisy, 500.0);
        while self.cache.written() < self.model.config().causal.window {
            self.cache.append(&kv);
        }
    }

    fn forward(&self, noisy: &Array, time: f32) -> (Array, ChunkKv) {
        let (transformer, config) = (self.model.transformer(), self.model.config());
        let [frames, n, ..] = noisy.shape() else { unreachable!("latents have four axes") };
        let control = transformer.control_of(&Array::zeros(&[*frames, *n, 4, config.control.channels]));
        let start = Array::zeros(&[*frames, *n, 4, config.vae.z]);
        let window = self.cache.window(transformer, *frames);
        transformer.denoise(&Chunk { noisy, start: &start, control: &control, time }, &window, &self.context)
    }

    /// Encodes layouts that follow those before.
    fn control(&mut self, count: usize) -> Control {
        let (model, config) = (&self.model, self.model.config());
        let layout = RgbImage::filled(config.video.width_px, config.video.height_px, [64; 3]);
        model.codec.control(&*model.dit, config, &vec![&layout; count], &mut self.layouts)
    }

    /// Denoises a chunk by all steps and caches it.
    ///
    /// # Errors
    /// If the device reports a fault.
    pub fn denoise(&mut self) -> Result<(), String> {
        let config = self.model.config();
        let (sigmas, source) = (sampler::sigmas(config.sampler.steps, config.sampler.shift), config.cache_source());
        let key = Digest::of(b"workload");
        let noise = |chunk: u32, step: usize, shape: &[usize]| sampler::noise(&key, "front", chunk, step, shape);
        let shape = self.clean.shape().to_vec();
        let mut state = noise(self.chunk, 1, &shape);
        let mut kept = None;
        for (step, sigma) in (1..).zip(&sigmas) {
            let (flow, kv) = self.forward(&state, 1000.0 * sigma);
            let clean = state.values().iter().zip(flow.values()).map(|(x, v)| x - sigma * v).collect();
            self.clean = Array::new(&shape, clean);
            if source == CacheSource::State(step) {
                kept = Some(kv);
            }
            if let Some(next) = sigmas.get(step) {
                state = sampler::noised(&self.clean, &noise(self.chunk, step + 1, &shape), *next);
            }
        }
        let kv = kept.unwrap_or_else(|| self.forward(&self.clean, 0.0).1);
        self.cache.append(&kv);
        self.chunk += 1;
        device::wait()
    }

    /// Decodes a chunk of latents. Returns the frames made.
    ///
    /// # Errors
    /// If the device reports a fault.
    pub fn decode(&mut self) -> Result<usize, String> {
        let config = self.model.config();
        let (h, w) = config.latent_size();
        let latents = drawn("latents", &[config.causal.chunk, h, w, config.vae.z]);
        let frames = self.model.codec.decode(latents, None, &mut self.decoder);
        device::wait().map(|()| frames.shape()[0])
    }

    /// Encodes the layouts of a chunk, where layouts go through the autoencoder.
    ///
    /// # Errors
    /// If the device reports a fault.
    pub fn encode(&mut self) -> Result<(), String> {
        let _control = self.control(self.model.config().frames_per_chunk());
        device::wait()
    }
}

/// Counts the operations of a chunk in steady state.
#[must_use]
pub fn operations(config: &ModelConfig) -> Operations {
    let (chunk, shape) = (config.causal.chunk, config.dit());
    let forwards = config.sampler.steps + usize::from(!matches!(config.cache_source(), CacheSource::State(_)));
    let ((h, w), vae) = (config.latent_size(), config.wan_vae().unwrap_or(WanVaeShape::WAN21));
    let (rows, columns) = (config.video.height_px as usize, config.video.width_px as usize);
    let decode = if config.vae.kind == "taew21" { tae::decode_operations(h, w) } else { vae.decode_operations(h, w) };
    let encode = if config.control.encoder == "vae" { vae.encode_operations(rows, columns) } else { 0.0 };
    Operations {
        denoise: forwards as f64 * work::denoise(&shape, chunk, config.causal.window - chunk),
        decode: chunk as f64 * decode,
        encode: chunk as f64 * encode,
    }
}

/// Returns the matrix product that a measurement is compared with, in the number format of the large layers.
#[must_use]
pub fn yardstick(config: &ModelConfig, side: usize) -> Product {
    Product::new(side, config.precision.linear.into())
}

/// Returns the bytes in use and reserved on the device, where it tells.
#[must_use]
pub fn memory() -> Option<(u64, u64)> {
    device::memory()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_the_published_ones() {
        let load = |text: &str| ModelConfig::parse(text).expect("a preset is valid");
        let check =
            |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 0.03, "{found:e}, {expected:e}");
        // Chunk 3, window 9, four steps whose third state is cached: 97.9 TF with image tokens, 24.5 TF per pass.
        let fun = operations(&load(include_str!("../../../../configs/models/wan2.1-fun-1.3b-control.toml")));
        check(fun.denoise, 97.9e12);
        check(fun.decode, 40.7e12);
        check(fun.encode, 24.2e12);
        // The figure for 5B, 156 TF, is of five passes and counts the image tokens that it does not have.
        let large = operations(&load(include_str!("../../../../configs/models/wan2.2-5b.toml")));
        check(large.denoise / 4.0, 156e12 / 5.0);
        assert!(large.encode < 1.0);
    }

    #[test]
    fn a_chunk_of_drawn_weights_is_finite() {
        let config = ModelConfig::parse(include_str!("../../../../configs/models/wan-tiny.toml")).expect("valid");
        let mut work = Workload::new(Backend::Framework, &config).expect("a processor is there");
        work.denoise().expect("a processor does not fail");
        assert!(work.clean.is_finite());
        assert_eq!(work.decode(), Ok(12));
    }
}

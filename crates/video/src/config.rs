//! The model's configuration: one TOML file per preset, checked on load, with errors that name the field.

use ds_nn::cache::{CachePolicy, Positions, ReadOrder};
use ds_nn::dit::DitShape;
use ds_nn::step::Prediction;
use ds_nn::tiny_ae::{AeShape, BLOCK_PX};
use ds_space::{Digest, DigestWriter};
use serde::{Deserialize, Serialize};

/// Says why a configuration is refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("model configuration {path:?} cannot be read")]
    Io {
        /// The file.
        path: String,
        /// The system's answer.
        #[source]
        source: std::io::Error,
    },
    /// The text is not TOML of the expected keys.
    #[error("model configuration cannot be read")]
    Syntax(#[from] toml::de::Error),
    /// A value breaks a rule.
    #[error("model configuration: field {field:?} is {value}: {rule}")]
    Field {
        /// The field, as section.key.
        field: &'static str,
        /// Its value.
        value: String,
        /// The broken rule.
        rule: &'static str,
    },
}

/// A model preset.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelConfig {
    /// Schema version, 1.
    pub version: u32,
    /// Name of the preset.
    pub name: String,
    /// Size of the video.
    pub video: VideoConfig,
    /// The transformer.
    pub model: DitConfig,
    /// The autoencoder.
    pub vae: VaeConfig,
    /// The layout path.
    pub control: ControlConfig,
    /// The few-step sampler.
    pub sampler: SamplerConfig,
    /// Chunks and cache.
    pub causal: CausalConfig,
}

/// Size of the video.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VideoConfig {
    /// Width, in pixels.
    pub width_px: u32,
    /// Height, in pixels.
    pub height_px: u32,
}

/// The transformer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DitConfig {
    /// Blocks.
    pub layers: usize,
    /// Model width.
    pub dim: usize,
    /// Attention heads.
    pub heads: usize,
    /// Feed-forward width.
    pub ffn: usize,
    /// Patch size in time, rows and columns: 1, 2, 2.
    pub patch: [usize; 3],
    /// Input channels: noisy, control and start latents.
    pub in_dim: usize,
    /// Output channels.
    pub out_dim: usize,
    /// Width of the sinusoidal time embedding.
    pub freq_dim: usize,
    /// Width of a prompt token.
    pub text_dim: usize,
    /// Prompt tokens; 0 leaves the prompt out.
    pub text_len: usize,
    /// First-frame tokens in the cross-attention context: 0, or all of a latent frame's.
    pub img_tokens: usize,
    /// Where the first frame's latent is an input channel: in its own frame (`first`) or in all (`every`).
    pub start: StartConfig,
    /// Cross-attention sits in every n-th block.
    pub cross_every: usize,
    /// What the output stands for: `clean` or `flow`.
    pub prediction: PredictionConfig,
}

/// Which frames are given the first frame's latent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StartConfig {
    /// The first alone, as in Wan.
    First,
    /// All of them: a steady reference for colour and light.
    Every,
}

/// What the output stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PredictionConfig {
    /// The clean latent.
    Clean,
    /// The flow ε − x0.
    Flow,
}

/// The autoencoder. Mean and deviation of its latents are part of the weights file (`vae.latent.mean`, `.std`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VaeConfig {
    /// Kind: `tiny`.
    pub kind: String,
    /// Latent channels.
    pub z: usize,
    /// Frames per latent step.
    pub stride_t: usize,
    /// Pixels per latent pixel, 8.
    pub stride_s: usize,
    /// Width of the encoder.
    pub encoder_width: usize,
    /// Memory blocks of the encoder.
    pub encoder_blocks: usize,
    /// Widths of the decoder's stages.
    pub decoder_widths: [usize; 3],
    /// Memory blocks of the decoder's stages.
    pub decoder_blocks: [usize; 3],
}

/// The layout path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlConfig {
    /// Kind: `unshuffle` (space-to-depth and a linear map).
    pub encoder: String,
    /// Channels of the control latent.
    pub channels: usize,
    /// Whether the decoder sees the layouts too, so that lines and boxes stay sharp at this size.
    #[serde(default)]
    pub decoder: bool,
}

/// The few-step sampler.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SamplerConfig {
    /// Denoising steps of a chunk.
    pub steps: usize,
    /// Time shift of the schedule.
    pub shift: f64,
}

/// Chunks and cache.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CausalConfig {
    /// Latent frames denoised together.
    pub chunk: usize,
    /// Latent frames that a chunk sees: sink, past and itself.
    pub window: usize,
    /// First latent frames that are never dropped.
    pub sink: usize,
    /// Position policy of cached keys: `cache_relative` or `absolute`.
    pub rope: RopeConfig,
    /// What is written to the cache: `clean`, `renoise(σ)`, `state(j)` or `x0hat(j)`.
    pub cache_source: String,
    /// Whether o_0 is a chunk of its own; always true.
    pub first_frame_independent: bool,
    /// Allows `state(1)`, the ablation arm that keeps pure noise.
    #[serde(default)]
    pub ablation: bool,
}

/// Position policy of cached keys.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RopeConfig {
    /// Relative to the window.
    CacheRelative,
    /// Since the start of the rollout.
    Absolute,
}

/// What is written to the cache for a chunk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CacheSource {
    /// The clean latent, labelled t = 0.
    Clean,
    /// The clean latent with noise of this σ.
    Renoise(f64),
    /// The noisy state that enters step j (from 1); its keys come for free.
    State(usize),
    /// The clean estimate after step j.
    X0Hat(usize),
}

impl CacheSource {
    fn parse(text: &str) -> Option<Self> {
        if text == "clean" {
            return Some(Self::Clean);
        }
        let (kind, argument) = text.strip_suffix(')')?.split_once('(')?;
        match kind {
            "renoise" => argument.parse().ok().map(Self::Renoise),
            "state" => argument.parse().ok().map(Self::State),
            "x0hat" => argument.parse().ok().map(Self::X0Hat),
            _ => None,
        }
    }
}

const MAX_WIDTH: usize = 8_192;

impl ModelConfig {
    /// Reads and checks a configuration file of at most a megabyte.
    ///
    /// # Errors
    /// If the file cannot be read, or as [`Self::parse`].
    pub fn load(path: &std::path::Path) -> Result<Self, ConfigError> {
        let io = |source| ConfigError::Io { path: path.display().to_string(), source };
        let file = std::fs::File::open(path).map_err(io)?;
        let mut text = String::new();
        std::io::Read::read_to_string(&mut std::io::Read::take(file, 1 << 20), &mut text).map_err(io)?;
        Self::parse(&text)
    }

    /// Reads and checks a configuration.
    ///
    /// # Errors
    /// [`ConfigError`] names the first field that is wrong.
    pub fn parse(text: &str) -> Result<Self, ConfigError> {
        let config: Self = toml::from_str(text)?;
        config.check()?;
        Ok(config)
    }

    /// Returns what is written to the cache.
    #[must_use]
    pub fn cache_source(&self) -> CacheSource {
        CacheSource::parse(&self.causal.cache_source).expect("checked when the configuration was read")
    }

    /// Returns the rows and columns of a latent frame.
    #[must_use]
    pub fn latent_size(&self) -> (usize, usize) {
        (self.video.height_px as usize / BLOCK_PX, self.video.width_px as usize / BLOCK_PX)
    }

    /// Returns the frames of a chunk of latents after the first.
    #[must_use]
    pub fn frames_per_chunk(&self) -> usize {
        self.causal.chunk * self.vae.stride_t
    }

    /// Returns the sizes of the transformer.
    #[must_use]
    pub fn dit(&self) -> DitShape {
        let (h, w) = self.latent_size();
        DitShape {
            layers: self.model.layers,
            dim: self.model.dim,
            heads: self.model.heads,
            ffn: self.model.ffn,
            latent_channels: self.vae.z,
            control_inputs: self.ae().inputs(),
            control_channels: self.control.channels,
            freq_dim: self.model.freq_dim,
            text_dim: self.model.text_dim,
            text_len: self.model.text_len,
            image_context: self.model.img_tokens > 0,
            start_every: self.model.start == StartConfig::Every,
            cross_every: self.model.cross_every,
            grid_h: h / 2,
            grid_w: w / 2,
        }
    }

    /// Returns the sizes of the autoencoder.
    #[must_use]
    pub fn ae(&self) -> AeShape {
        AeShape {
            z: self.vae.z,
            stride_t: self.vae.stride_t,
            encoder_width: self.vae.encoder_width,
            encoder_blocks: self.vae.encoder_blocks,
            decoder_widths: self.vae.decoder_widths,
            decoder_blocks: self.vae.decoder_blocks,
            guided: self.control.decoder,
        }
    }

    /// Returns sizes and policy of the cache.
    #[must_use]
    pub fn cache(&self) -> CachePolicy {
        CachePolicy {
            window: self.causal.window,
            sink: self.causal.sink,
            chunk: self.causal.chunk,
            positions: match self.causal.rope {
                RopeConfig::CacheRelative => Positions::CacheRelative,
                RopeConfig::Absolute => Positions::Absolute,
            },
            order: ReadOrder::Slot,
        }
    }

    /// Returns what the transformer's output stands for.
    #[must_use]
    pub fn prediction(&self) -> Prediction {
        match self.model.prediction {
            PredictionConfig::Clean => Prediction::Clean,
            PredictionConfig::Flow => Prediction::Flow,
        }
    }

    /// Returns the digest of the configuration's values.
    #[must_use]
    pub fn digest(&self) -> Digest {
        let text = toml::to_string(self).expect("the configuration came from TOML");
        DigestWriter::new().text(&text).finish()
    }

    fn check(&self) -> Result<(), ConfigError> {
        let (m, v, c) = (&self.model, &self.vae, &self.causal);
        let head = m.dim.checked_div(m.heads).unwrap_or(0);
        let (h, w) = self.latent_size();
        let sizes = [m.layers, m.dim, m.heads, m.ffn, m.freq_dim, m.cross_every, v.z, v.encoder_width];
        let side = 8 * 2;
        let refuse = |field, value: String, rule| Err(ConfigError::Field { field, value, rule });
        if self.version != 1 {
            return refuse("version", self.version.to_string(), "must be 1");
        }
        for (field, pixels) in [("video.width_px", self.video.width_px), ("video.height_px", self.video.height_px)] {
            if pixels == 0 || pixels > 4_096 || pixels % side != 0 {
                return refuse(field, pixels.to_string(), "must be 16 to 4096 and divisible by stride·patch, 16");
            }
        }
        if sizes.iter().chain(&v.decoder_widths).any(|size| *size == 0 || *size > MAX_WIDTH) {
            return refuse("model, vae", format!("{sizes:?}"), "sizes must be 1 to 8192");
        }
        if m.layers > 128 || v.encoder_blocks.max(*v.decoder_blocks.iter().max().unwrap_or(&0)) > 16 {
            return refuse("model.layers", m.layers.to_string(), "at most 128 layers and 16 memory blocks");
        }
        if head * m.heads != m.dim || head % 2 == 1 || head < 12 {
            return refuse("model.heads", m.heads.to_string(), "must divide dim into even heads of 12 or more");
        }
        if m.patch != [1, 2, 2] {
            return refuse("model.patch", format!("{:?}", m.patch), "must be [1, 2, 2]");
        }
        if m.freq_dim % 2 == 1 {
            return refuse("model.freq_dim", m.freq_dim.to_string(), "must be even");
        }
        if m.in_dim != 2 * v.z + self.control.channels {
            return refuse("model.in_dim", m.in_dim.to_string(), "must be 2·vae.z + control.channels");
        }
        if m.out_dim != v.z {
            return refuse("model.out_dim", m.out_dim.to_string(), "must be vae.z");
        }
        if m.text_len > 1_024 || (m.text_len > 0) != (m.text_dim > 0) || m.text_dim > MAX_WIDTH {
            return refuse("model.text_len", m.text_len.to_string(), "at most 1024, and 0 exactly if text_dim is 0");
        }
        if m.img_tokens != 0 && m.img_tokens != h * w / 4 {
            return refuse("model.img_tokens", m.img_tokens.to_string(), "must be 0 or the tokens of a latent frame");
        }
        if v.kind != "tiny" {
            return refuse("vae.kind", v.kind.clone(), "must be \"tiny\"");
        }
        if !matches!(v.stride_t, 1 | 2 | 4) || v.stride_s != BLOCK_PX || v.z > 64 {
            return refuse("vae.stride_t", v.stride_t.to_string(), "must be 1, 2 or 4, with stride_s 8 and z up to 64");
        }
        if self.control.encoder != "unshuffle" || self.control.channels == 0 || self.control.channels > MAX_WIDTH {
            return refuse("control.encoder", self.control.encoder.clone(), "must be \"unshuffle\" with channels");
        }
        if self.sampler.steps == 0
            || self.sampler.steps > 64
            || !(self.sampler.shift >= 1.0 && self.sampler.shift < 100.0)
        {
            return refuse("sampler.steps", self.sampler.steps.to_string(), "must be 1 to 64 with a shift of 1 to 100");
        }
        if c.chunk == 0 || c.window > 1_024 || c.window < c.sink + c.chunk {
            return refuse("causal.window", c.window.to_string(), "must be at least sink + chunk and at most 1024");
        }
        if !c.first_frame_independent {
            return refuse("causal.first_frame_independent", "false".to_owned(), "must be true");
        }
        self.check_cache_source()
    }

    fn check_cache_source(&self) -> Result<(), ConfigError> {
        let (text, steps) = (&self.causal.cache_source, self.sampler.steps);
        let fits = match CacheSource::parse(text) {
            Some(CacheSource::Clean) => true,
            Some(CacheSource::Renoise(sigma)) => (0.0..1.0).contains(&sigma),
            Some(CacheSource::State(1)) => self.causal.ablation,
            Some(CacheSource::State(step)) => (2..=steps).contains(&step),
            Some(CacheSource::X0Hat(step)) => (1..steps).contains(&step),
            None => false,
        };
        let rule = "must be clean, renoise(0 to 1), state(2 to steps), or x0hat(1 to steps − 1)";
        if fits { Ok(()) } else { Err(ConfigError::Field { field: "causal.cache_source", value: text.clone(), rule }) }
    }
}

#[cfg(test)]
mod tests;

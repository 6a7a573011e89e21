//! The model's configuration: one TOML file per preset, checked on load, with errors that name the field.

use ds_graph::device::Precision;
use ds_graph::published::wan_vae::WanVaeShape;
use ds_nn::cache::{CachePolicy, Positions, ReadOrder};
use ds_nn::dit::{DitShape, Gelu};
use ds_nn::step::Prediction;
use ds_nn::tiny_ae::AeShape;
use ds_space::{Digest, DigestWriter};
use serde::{Deserialize, Serialize};

mod check;
mod encoder;
mod falls;
mod published;

pub use encoder::BlocksConfig;
pub use falls::FallsConfig;
pub use published::{ImageEncoderConfig, TextEncoderConfig, WeightsConfig};

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
    /// Number formats.
    #[serde(default, skip_serializing_if = "is_default")]
    pub precision: PrecisionConfig,
    /// The files of a published model.
    #[serde(default, skip_serializing_if = "is_default")]
    pub weights: WeightsConfig,
    /// The prompt encoder of a published model.
    #[serde(default, skip_serializing_if = "is_default")]
    pub text_encoder: TextEncoderConfig,
    /// The image encoder of a published model.
    #[serde(default, skip_serializing_if = "is_default")]
    pub image_encoder: ImageEncoderConfig,
}

/// Number formats of published weights; own models are f32.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PrecisionConfig {
    /// The transformer's large layers and its cache: `f32` or `bf16`.
    pub linear: FormatConfig,
    /// The decoder's convolutions: `f32` or `bf16`. The encoder is always f32.
    pub vae_decode: FormatConfig,
}

/// A number format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FormatConfig {
    /// 32 bits.
    #[default]
    F32,
    /// 16 bits with the exponent range of f32.
    Bf16,
}

impl From<FormatConfig> for Precision {
    fn from(format: FormatConfig) -> Self {
        match format {
            FormatConfig::F32 => Self::F32,
            FormatConfig::Bf16 => Self::Bf16,
        }
    }
}

/// Fields that came later are left out where they say nothing new, so that older weights keep their configuration's digest.
fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
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
    /// Input channels: noisy, control and start latents, in this order.
    pub in_dim: usize,
    /// Output channels.
    pub out_dim: usize,
    /// Width of the sinusoidal time embedding.
    pub freq_dim: usize,
    /// Width of a prompt token.
    pub text_dim: usize,
    /// Prompt tokens; 0 leaves the prompt out.
    pub text_len: usize,
    /// First-frame tokens in the cross-attention context: 0, all of a latent frame's, or those of CLIP.
    pub img_tokens: usize,
    /// Width of CLIP's states; 0 where the first frame's latent itself is the context.
    #[serde(default, skip_serializing_if = "is_default")]
    pub clip_dim: usize,
    /// Whether the weights know a reference frame in front of the clip.
    #[serde(default, skip_serializing_if = "is_default")]
    pub reference: bool,
    /// The form of the GELU: `exact`, or `tanh` as in Wan.
    #[serde(default, skip_serializing_if = "is_default")]
    pub gelu: GeluConfig,
    /// Where the first frame's latent is an input channel: in its own frame (`first`), in all (`every`) or in `none`.
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
    /// None: there are no such channels.
    None,
}

/// The form of the GELU.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GeluConfig {
    /// By the error function.
    #[default]
    Exact,
    /// By the hyperbolic tangent.
    Tanh,
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

/// The autoencoder. Mean and deviation of an own one's latents are part of the weights file (`vae.latent.mean`, `.std`).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VaeConfig {
    /// Kind: `tiny`, or a published one: `wan21`, `wan22`, or `taew21`, the tiny one for latents of Wan2.1.
    pub kind: String,
    /// Latent channels.
    pub z: usize,
    /// Frames per latent step.
    pub stride_t: usize,
    /// Pixels per latent pixel: 8, or 16 for `wan22`.
    pub stride_s: usize,
    /// Base width of both halves of Wan's autoencoder; 0 for the published one.
    #[serde(default, skip_serializing_if = "is_default")]
    pub width: usize,
    /// Width of an encoder at 1/8 resolution alone; this and what follows belong to `tiny`.
    #[serde(default)]
    pub encoder_width: usize,
    /// Widths of an encoder in stages, at 1/2, 1/4 and 1/8 resolution, in place of `encoder_width`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub encoder_widths: Option<[usize; 3]>,
    /// Memory blocks of the encoder, or of each of its stages.
    #[serde(default)]
    pub encoder_blocks: BlocksConfig,
    /// Widths of the decoder's stages.
    #[serde(default)]
    pub decoder_widths: [usize; 3],
    /// Memory blocks of the decoder's stages.
    #[serde(default)]
    pub decoder_blocks: [usize; 3],
    /// Whether a linear map from latent to block runs beside the decoder.
    #[serde(default = "yes", skip_serializing_if = "Clone::clone")]
    pub decoder_skip: bool,
}

fn yes() -> bool {
    true
}

/// The layout path.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlConfig {
    /// Kind: `unshuffle` (space-to-depth and a linear map), `vae` (the layout as a video through the autoencoder), or
    /// `none`.
    pub encoder: String,
    /// Channels of the control latent.
    pub channels: usize,
    /// Convolutions of the decoder that see the layouts too, so that lines and boxes stay sharp at this size.
    #[serde(default)]
    pub decoder_layers: usize,
    /// Widths at 1/8, 1/4 and 1/2 resolution of the sketch of the layout that these convolutions see; without it, the layout itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sketch_widths: Option<[usize; 3]>,
    /// Whether these convolutions also see the last frame of the chunk before, carried to where the geometry of the layouts says that
    /// its parts are now.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub carried: bool,
    /// The words of a prompt by which something falls: it is then drawn anew at each tick, before frames that know nothing of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub falls: Option<FallsConfig>,
    /// Mean colours of vehicles beside a frame of medium brightness, from which the paint of each that comes into view is drawn.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub paints: Vec<[u8; 3]>,
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

impl ModelConfig {
    /// Returns whether a prompt is a bag of hashed words to the model, of which it knows those of its training alone.
    #[must_use]
    pub fn hashes_words(&self) -> bool {
        is_default(&self.text_encoder)
    }

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
        let stride = self.vae.stride_s.max(1);
        (self.video.height_px as usize / stride, self.video.width_px as usize / stride)
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
            control_inputs: if self.control.encoder == "unshuffle" { self.ae().inputs() } else { 0 },
            control_channels: self.control.channels,
            start_channels: self.start_channels(),
            freq_dim: self.model.freq_dim,
            text_dim: self.model.text_dim,
            text_len: self.model.text_len,
            image_context: self.model.img_tokens > 0 && self.model.clip_dim == 0,
            clip_dim: self.model.clip_dim,
            reference: self.model.reference,
            gelu: match self.model.gelu {
                GeluConfig::Exact => Gelu::Exact,
                GeluConfig::Tanh => Gelu::Tanh,
            },
            start_every: self.model.start == StartConfig::Every,
            cross_every: self.model.cross_every,
            grid_h: h / 2,
            grid_w: w / 2,
        }
    }

    fn start_channels(&self) -> usize {
        if self.model.start == StartConfig::None { 0 } else { self.vae.z }
    }

    /// Says whether the weights are published ones, which lie in files of their own.
    #[must_use]
    pub fn is_published(&self) -> bool {
        self.vae.kind != "tiny"
    }

    /// Returns the sizes of Wan's autoencoder, if that is the kind; the tiny one takes latents of Wan2.1.
    #[must_use]
    pub fn wan_vae(&self) -> Option<WanVaeShape> {
        let published = match self.vae.kind.as_str() {
            "wan21" | "taew21" => WanVaeShape::WAN21,
            "wan22" => WanVaeShape::WAN22,
            _ => return None,
        };
        let width = self.vae.width;
        Some(if width == 0 {
            published
        } else {
            WanVaeShape { encoder_width: width, decoder_width: width, ..published }
        })
    }

    /// Returns the sizes of the own autoencoder.
    #[must_use]
    pub fn ae(&self) -> AeShape {
        AeShape {
            z: self.vae.z,
            stride_t: self.vae.stride_t,
            encoder_widths: self.vae.encoder().to_vec(),
            encoder_blocks: self.vae.encoder_blocks.each().to_vec(),
            decoder_widths: self.vae.decoder_widths,
            decoder_blocks: self.vae.decoder_blocks,
            decoder_skip: self.vae.decoder_skip,
            guides: self.control.decoder_layers,
            sketch_widths: self.control.sketch_widths,
            carried: self.control.carried,
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

    /// Returns the digest of the configuration's values; where files lie is none of them.
    #[must_use]
    pub fn digest(&self) -> Digest {
        let weights = WeightsConfig { drawn: self.weights.drawn, ..WeightsConfig::default() };
        let text = toml::to_string(&Self { weights, ..self.clone() }).expect("the configuration came from TOML");
        DigestWriter::new().text(&text).finish()
    }
}

#[cfg(test)]
mod tests;

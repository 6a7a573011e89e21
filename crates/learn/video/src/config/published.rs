//! What only published models have in a configuration: where their files lie, and the sizes of their encoders.

use std::path::{Path, PathBuf};

use ds_graph::published::clip::ClipShape;
use ds_graph::published::umt5::Umt5Shape;
use serde::{Deserialize, Serialize};

use super::check::MAX_WIDTH;
use super::{ConfigError, ModelConfig, is_default};

/// The files of a published model, relative to the folder of its weights. Each may be a safetensors file, an index of
/// shards, a PyTorch archive, or a folder that holds one of them.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WeightsConfig {
    /// Takes drawn weights and reads no file: for trials of speed and wiring, what comes out means nothing.
    #[serde(skip_serializing_if = "is_default")]
    pub drawn: bool,
    /// The transformer.
    pub transformer: PathBuf,
    /// Wan's autoencoder; kind `taew21` needs its encoder.
    pub vae: PathBuf,
    /// The tiny autoencoder of kind `taew21`.
    pub decoder: PathBuf,
    /// The UMT5 encoder.
    pub text: PathBuf,
    /// Its tokeniser, a model of sentencepiece.
    pub tokeniser: PathBuf,
    /// The CLIP image encoder.
    pub image: PathBuf,
}

/// Sizes of the prompt encoder; its width is `model.text_dim`. The default is UMT5-XXL.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TextEncoderConfig {
    /// Tokens of the vocabulary.
    pub vocabulary: usize,
    /// Width of all heads together.
    pub attention: usize,
    /// Heads.
    pub heads: usize,
    /// Feed-forward width.
    pub ffn: usize,
    /// Layers.
    pub layers: usize,
}

impl Default for TextEncoderConfig {
    fn default() -> Self {
        let Umt5Shape { vocabulary, attention, heads, ffn, layers, .. } = Umt5Shape::XXL;
        Self { vocabulary, attention, heads, ffn, layers }
    }
}

/// Sizes of the image encoder; its width is `model.clip_dim`. The default is ViT-H/14.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImageEncoderConfig {
    /// Side of the image, in pixels.
    pub image_px: usize,
    /// Side of a patch, in pixels.
    pub patch_px: usize,
    /// Heads.
    pub heads: usize,
    /// Feed-forward width.
    pub ffn: usize,
    /// Blocks, the last included, which is not run.
    pub layers: usize,
}

impl Default for ImageEncoderConfig {
    fn default() -> Self {
        let ClipShape { image, patch, heads, ffn, layers, .. } = ClipShape::H14;
        Self { image_px: image, patch_px: patch, heads, ffn, layers }
    }
}

impl ModelConfig {
    /// Returns the sizes of the prompt encoder.
    #[must_use]
    pub fn umt5(&self) -> Umt5Shape {
        let TextEncoderConfig { vocabulary, attention, heads, ffn, layers } = self.text_encoder;
        Umt5Shape { vocabulary, dim: self.model.text_dim, attention, heads, ffn, layers, ..Umt5Shape::XXL }
    }

    /// Returns the sizes of the image encoder.
    #[must_use]
    pub fn clip(&self) -> ClipShape {
        let ImageEncoderConfig { image_px, patch_px, heads, ffn, layers } = self.image_encoder;
        ClipShape { image: image_px, patch: patch_px, dim: self.model.clip_dim, heads, ffn, layers }
    }

    /// Returns where the weights lie unless they are named: beside the configuration, an own model's in the file of its
    /// name that ends in `.safetensors`, a published one's in the folder of its name.
    #[must_use]
    pub fn weights_beside(&self, configuration: &Path) -> PathBuf {
        configuration.with_extension(if self.is_published() { "" } else { "safetensors" })
    }

    /// Returns how many ticks before the chunk under way a successor needs layouts of, whole chunks of them: those that
    /// the encoder of the layout video remembers, or the last ones, from where a frame is carried on. 0 where layouts leave no memory.
    #[must_use]
    pub fn layout_memory_ticks(&self) -> usize {
        let chunk = self.frames_per_chunk();
        match self.wan_vae() {
            Some(vae) if self.control.channels > 0 => chunk * (1 + vae.encoder_reach().div_ceil(chunk)),
            None if self.control.carried => chunk,
            _ => 0,
        }
    }

    /// The rules of files and encoders.
    pub(super) fn check_files(&self) -> Result<(), ConfigError> {
        let m = &self.model;
        let refuse = |field, value: String, rule| Err(ConfigError::Field { field, value, rule });
        if !self.is_published() {
            // An own model's weights may be drawn, for trials of speed; then the key is all that stands here.
            let files = WeightsConfig { drawn: false, ..self.weights.clone() };
            let own = is_default(&files) && is_default(&self.text_encoder) && is_default(&self.image_encoder);
            let rule = "files and encoders belong to published models";
            return if own { Ok(()) } else { refuse("weights", format!("{:?}", self.weights), rule) };
        }
        for (field, file, wanted, rule) in [
            ("weights.decoder", &self.weights.decoder, self.vae.kind == "taew21", "belongs to vae.kind taew21"),
            ("weights.text", &self.weights.text, m.text_len > 0, "belongs to models with model.text_len"),
            ("weights.tokeniser", &self.weights.tokeniser, m.text_len > 0, "belongs to models with model.text_len"),
            ("weights.image", &self.weights.image, m.clip_dim > 0, "belongs to models with model.clip_dim"),
        ] {
            if !wanted && !file.as_os_str().is_empty() {
                return refuse(field, format!("{file:?}"), rule);
            }
        }
        let fit = |sizes: &[usize]| sizes.iter().all(|size| (1..=MAX_WIDTH).contains(size));
        let TextEncoderConfig { vocabulary, attention, heads, ffn, layers } = self.text_encoder;
        if !fit(&[attention, heads, ffn, layers]) || vocabulary == 0 || vocabulary > 1 << 24 || attention % heads != 0 {
            let rule = "sizes must be 1 to 16384 with heads that divide attention";
            return refuse("text_encoder", format!("{:?}", self.text_encoder), rule);
        }
        let ImageEncoderConfig { image_px, patch_px, heads, ffn, layers } = self.image_encoder;
        if !fit(&[image_px, patch_px, heads, ffn, layers])
            || !image_px.is_multiple_of(patch_px)
            || !m.clip_dim.is_multiple_of(heads)
        {
            let rule = "sizes must be 1 to 16384 with patches that divide the image and heads that divide clip_dim";
            return refuse("image_encoder", format!("{:?}", self.image_encoder), rule);
        }
        if m.clip_dim > 0 && m.img_tokens != self.clip().tokens() {
            let rule = "must be the patches of image_encoder and one, 257 for ViT-H/14, where clip_dim is given";
            return refuse("model.img_tokens", m.img_tokens.to_string(), rule);
        }
        Ok(())
    }
}

//! What cross-attention sees of a rollout: its prompt and its first frame.
//!
//! Own models take hashed words and the first frame's latent. Published ones take the states of UMT5 and, where they
//! have layers for them, of CLIP.

use ds_graph::published::clip::Clip;
use ds_graph::published::umt5::Umt5;
use ds_nn::Array;
use ds_nn::body::{Context, Transformer};
use ds_nn::sentencepiece::Tokeniser;
use ds_raster::RgbImage;

use crate::config::DitConfig;
use crate::error::VideoError;
use crate::{prompt, sampler};

/// The encoders of prompt and first frame.
#[expect(clippy::large_enum_variant, reason = "one a model")]
pub(crate) enum Conditions {
    /// Hashed words and the latent; where a shape asks for states of CLIP, drawn ones.
    Hashed,
    /// Encoders, as far as the model attends to what they give.
    Encoded { text: Option<PromptEncoder>, image: Option<Clip> },
}

/// UMT5 with its tokeniser, whose tokens all lie in the encoder's vocabulary.
pub(crate) struct PromptEncoder {
    pub(crate) encoder: Umt5,
    pub(crate) tokeniser: Tokeniser,
}

impl Conditions {
    /// Computes the context of a prompt and a first frame, whose clean tokens are [1, tokens, 4, z].
    pub(crate) fn context(
        &self,
        dit: &dyn Transformer,
        model: &DitConfig,
        prompt: &str,
        frame: &RgbImage,
        clean: &Array,
    ) -> Result<Context, VideoError> {
        let text = match self {
            Self::Encoded { text: Some(text), .. } => {
                let tokens = text.tokeniser.tokens(prompt::bounded(prompt), model.text_len);
                text.encoder.states(&tokens, model.text_len).map_err(VideoError::Prompt)?
            }
            Self::Hashed | Self::Encoded { .. } => prompt::hashed(prompt, model.text_len, model.text_dim),
        };
        let states = match self {
            Self::Encoded { image: Some(clip), .. } => Some(clip.states(&unit(frame))),
            Self::Hashed if model.clip_dim > 0 => {
                let shape = [1, model.img_tokens, model.clip_dim];
                Some(sampler::noise(&clean.digest(), "first-frame", 0, 0, &shape))
            }
            Self::Hashed | Self::Encoded { .. } => None,
        };
        Ok(dit.context(&text, states.as_ref().unwrap_or(clean)))
    }
}

/// Turns an image into [rows, columns, 3] values of 0 to 1.
fn unit(image: &RgbImage) -> Array {
    let shape = [image.height_px() as usize, image.width_px() as usize, 3];
    Array::new(&shape, image.values().map(|value| (value + 1.0) * 0.5).collect())
}

//! Frames of a model's weights made otherwise than the model was trained for: what shows what each part is worth.
//!
//! Two need nothing but the weights ([`Ablation::CleanCache`], [`Ablation::NoLayout`]) and are worse for not having been
//! trained so; [`Ablation::Transformer`] takes a transformer of a training of its own. Of own models alone.

use std::path::{Path, PathBuf};

use ds_nn::Weights;
use ds_nn::tiny_ae::AeShape;
use ds_space::{Digest, DigestWriter};

use crate::backend::Backend;
use crate::config::ModelConfig;
use crate::error::VideoError;
use crate::model::VideoModel;

/// What is taken from a model.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ablation {
    /// Keys and values of noisy states: clean latents are cached.
    CleanCache,
    /// The layout: every one counts as the null condition of training.
    NoLayout,
    /// The transformer, for that of a file, with or without the prefix `dit.`.
    Transformer(PathBuf),
}

/// An own model's configuration and weights with something taken from them.
pub struct Ablated {
    config: ModelConfig,
    weights: Weights,
}

impl Ablated {
    /// Reads a model and takes something from it.
    ///
    /// # Errors
    /// If the model is a published one, or a file is broken or names another configuration.
    pub fn read(config: &ModelConfig, weights: &Path, ablation: &Ablation) -> Result<Self, VideoError> {
        if config.is_published() {
            return Err(VideoError::Ablation);
        }
        let weights =
            if config.weights.drawn { VideoModel::drawn_weights(config) } else { VideoModel::read(config, weights)? };
        Self::of(config, weights, ablation)
    }

    fn of(config: &ModelConfig, mut weights: Weights, ablation: &Ablation) -> Result<Self, VideoError> {
        let mut config = config.clone();
        match ablation {
            Ablation::CleanCache => {
                "clean".clone_into(&mut config.causal.cache_source);
                config.causal.ablation = true;
            }
            Ablation::NoLayout => weights = silenced(&config.ae(), &weights),
            Ablation::Transformer(path) => replace_transformer(&mut weights, &config, path)?,
        }
        Ok(Self { config, weights })
    }

    /// Returns the digest that the model will have.
    #[must_use]
    pub fn digest(&self) -> Digest {
        VideoModel::digest_of(&self.config, &self.weights)
    }

    /// Binds the weights for a back end.
    ///
    /// # Errors
    /// If the device is absent or the weights do not fit.
    pub fn model(&self, backend: Backend) -> Result<VideoModel, VideoError> {
        backend.ready()?;
        Ok(VideoModel::new_on(backend, &self.config, &self.weights)?)
    }
}

/// Returns the digest of a model that makes each frame anew.
#[must_use]
pub fn per_frame_digest(model: &Digest) -> Digest {
    DigestWriter::new().text("per frame").digest(model).finish()
}

/// Puts the transformer of a file, with or without its prefix, in the place of the model's; `config` is that of its training.
///
/// # Errors
/// If the file is broken or names another configuration.
pub fn replace_transformer(weights: &mut Weights, config: &ModelConfig, file: &Path) -> Result<(), VideoError> {
    let dit = VideoModel::read(config, file)?;
    let names: Vec<String> =
        weights.iter().map(|(name, _)| name.to_owned()).filter(|name| name.starts_with("dit.")).collect();
    names.iter().for_each(|name| drop(weights.remove(name)));
    let prefixed = dit.part("dit.");
    weights.absorb("dit.", if prefixed.iter().next().is_some() { &prefixed } else { &dit });
    Ok(())
}

/// A logistic function of this is 0 in single precision.
const NOTHING: f32 = -200.0;

/// Returns weights whose control latents are zero, and to which a guided decoder's view of the layout is zero.
#[must_use]
pub fn silenced(shape: &AeShape, weights: &Weights) -> Weights {
    let mut silent = weights.clone();
    for (name, array) in silent.iter_mut() {
        if name.starts_with("dit.control_embedding.") {
            array.values_mut().fill(0.0);
        }
    }
    for (name, seen) in shape.layout_inputs() {
        let Some(array) = silent.get_mut(&format!("vae.{name}.weight")) else { continue };
        // Each row holds, for each of nine taps, the decoder's own channels and then those of the layout.
        let inputs = array.values().len() / array.shape()[0] / 9;
        for tap in array.values_mut().chunks_exact_mut(inputs) {
            tap[inputs - seen..].fill(0.0);
        }
    }
    // What is carried goes by the layout's geometry: nothing of it is shown.
    if let Some(bias) = silent.get_mut("vae.decoder.guide.blend.bias") {
        bias.values_mut().fill(NOTHING);
    }
    if let Some(weight) = silent.get_mut("vae.decoder.guide.blend.weight") {
        weight.values_mut().fill(0.0);
    }
    silent
}

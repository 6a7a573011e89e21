//! A model's weights bound for inference, shared by all rollouts of a process.
//!
//! The weights file of an own model holds `dit.*`, `vae.encoder.*`, `vae.decoder.*` and the statistics `vae.latent.mean`
//! and `vae.latent.std`; its metadata may name the digest of the configuration it was trained for. A published model has
//! a file for each of its networks.

use std::path::Path;

use ds_nn::body::{Autoencoder, Transformer};
use ds_nn::safetensors::WeightsFile;
use ds_nn::{Array, Declared, Initial, Weights, WeightsError};
use ds_space::{Digest, DigestWriter};

use crate::backend::Backend;
use crate::codec::Codec;
use crate::conditions::Conditions;
use crate::config::ModelConfig;
use crate::error::VideoError;
use crate::published::{self, Parts};

/// Metadata key of the configuration's digest.
pub(crate) const CONFIG_DIGEST: &str = "config_digest";

/// A video model: configuration and weights.
pub struct VideoModel {
    config: ModelConfig,
    backend: Backend,
    pub(crate) dit: Box<dyn Transformer>,
    pub(crate) codec: Codec,
    pub(crate) conditions: Conditions,
    digest: Digest,
}

impl VideoModel {
    /// Reads a weights file for a configuration, for the default back end.
    ///
    /// # Errors
    /// As [`Self::load_on`].
    pub fn load(config: &ModelConfig, weights: &Path) -> Result<Self, VideoError> {
        Self::load_on(Backend::default(), config, weights)
    }

    /// Reads a weights file for a configuration and a back end; of a published model the folder that its files lie in,
    /// or none where `weights.drawn` says so.
    ///
    /// # Errors
    /// If the device is absent, or a file is broken, names another configuration, or does not hold exactly the model's
    /// weights, or if a published model is to run on the processor's own path.
    pub fn load_on(backend: Backend, config: &ModelConfig, weights: &Path) -> Result<Self, VideoError> {
        if config.weights.drawn {
            return Self::drawn(backend, config);
        }
        if config.is_published() {
            return Ok(Self::of(backend, config, published::load(backend, config, weights)?));
        }
        backend.ready()?;
        Ok(Self::new_on(backend, config, &Self::read(config, weights)?)?)
    }

    /// Reads the weights of an own model, which must have been trained for the configuration.
    ///
    /// # Errors
    /// If the file is broken or names another configuration.
    pub fn read(config: &ModelConfig, weights: &Path) -> Result<Weights, VideoError> {
        let file = WeightsFile::read(weights)?;
        let expected = config.digest().to_string();
        match file.metadata.get(CONFIG_DIGEST).filter(|found| **found != expected) {
            Some(found) => Err(VideoError::OtherConfig { expected, found: found.clone() }),
            None => Ok(file.weights),
        }
    }

    /// Makes a model of drawn weights whatever its configuration says of files, a published one with hashed words and
    /// drawn states of CLIP: for trials of speed and wiring.
    ///
    /// # Errors
    /// If the device is absent, or the processor's own path for a published model.
    pub fn drawn(backend: Backend, config: &ModelConfig) -> Result<Self, VideoError> {
        if config.is_published() {
            return Ok(Self::of(backend, config, published::drawn(backend, config)?));
        }
        backend.ready()?;
        Ok(Self::new_on(backend, config, &Self::drawn_weights(config))?)
    }

    /// Draws the weights of an own model.
    pub(crate) fn drawn_weights(config: &ModelConfig) -> Weights {
        let seed = DigestWriter::new().text("drawn").finish();
        Weights::initialised(&Self::declare(config), &seed)
    }

    /// Returns the digest of an own model of these weights.
    pub(crate) fn digest_of(config: &ModelConfig, weights: &Weights) -> Digest {
        DigestWriter::new().digest(&config.digest()).digest(&weights.digest()).finish()
    }

    fn of(backend: Backend, config: &ModelConfig, parts: Parts) -> Self {
        let Parts { dit, codec, conditions, digest } = parts;
        Self { config: config.clone(), backend, dit, codec, conditions, digest }
    }

    /// Makes a model of first weights drawn from a seed: for tests and for the start of training.
    #[must_use]
    pub fn untrained(config: &ModelConfig, seed: &Digest) -> Self {
        let weights = Weights::initialised(&Self::declare(config), seed);
        Self::new(config, &weights).expect("initialised weights fit their declarations")
    }

    /// Lists all weights of an own model's configuration.
    #[must_use]
    pub fn declare(config: &ModelConfig) -> Vec<Declared> {
        let under = |prefix: &'static str| move |d: Declared| Declared { name: format!("{prefix}{}", d.name), ..d };
        let mut list: Vec<Declared> = config.dit().declare().into_iter().map(under("dit.")).collect();
        list.extend(config.ae().declare().into_iter().map(under("vae.")));
        list.push(Declared::new("vae.latent.mean", &[config.vae.z], Initial::Constant(0.0)));
        list.push(Declared::new("vae.latent.std", &[config.vae.z], Initial::Constant(1.0)));
        list
    }

    /// Binds weights for the default back end.
    ///
    /// # Errors
    /// As [`Self::new_on`].
    pub fn new(config: &ModelConfig, weights: &Weights) -> Result<Self, WeightsError> {
        Self::new_on(Backend::default(), config, weights)
    }

    /// Binds weights for a back end.
    ///
    /// # Errors
    /// If a weight is missing, extra, misshapen or not finite.
    pub fn new_on(backend: Backend, config: &ModelConfig, weights: &Weights) -> Result<Self, WeightsError> {
        weights.check(&Self::declare(config))?;
        let statistic = |name: &str| weights.get(name).map(|array| array.values().to_vec()).unwrap_or_default();
        let (mean, std) = (statistic("vae.latent.mean"), statistic("vae.latent.std"));
        if let Some(index) = std.iter().position(|value| *value <= 0.0) {
            let name = "vae.latent.std".to_owned();
            return Err(WeightsError::NotFinite { name, index, value: std[index] });
        }
        let mut vae = weights.part("vae.");
        vae.remove("latent.mean");
        vae.remove("latent.std");
        let digest = Self::digest_of(config, weights);
        let dit = backend.transformer(&config.dit(), &weights.part("dit."))?;
        let codec = Codec::own(backend.autoencoder(&config.ae(), &vae)?, mean, std);
        Ok(Self::of(backend, config, Parts { dit, codec, conditions: Conditions::Hashed, digest }))
    }

    /// Returns the configuration.
    #[must_use]
    pub fn config(&self) -> &ModelConfig {
        &self.config
    }

    /// Returns what computes.
    #[must_use]
    pub fn backend(&self) -> Backend {
        self.backend
    }

    /// Returns the transformer.
    #[must_use]
    pub fn transformer(&self) -> &dyn Transformer {
        &*self.dit
    }

    /// Returns the autoencoder of an own model.
    ///
    /// # Panics
    /// If the model is a published one.
    #[must_use]
    pub fn autoencoder(&self) -> &dyn Autoencoder {
        self.codec.autoencoder().expect("the model is an own one")
    }

    /// Returns the digest of configuration and weights.
    #[must_use]
    pub fn digest(&self) -> Digest {
        self.digest
    }

    /// Brings latents, channels last, to zero mean and unit deviation.
    #[must_use]
    pub fn normalised(&self, latents: Array) -> Array {
        self.codec.normalised(latents)
    }

    /// Undoes [`Self::normalised`].
    #[must_use]
    pub fn denormalised(&self, latents: Array) -> Array {
        self.codec.denormalised(latents)
    }
}

//! A network ready to look at frames: its weights bound, their digest at hand. The same for every task.

use std::path::Path;

use ds_nn::safetensors::WeightsFile;
use ds_nn::{Weights, WeightsError};
use ds_space::Digest;

use crate::error::PerceptionError;

/// What a network tells of a frame.
pub trait Task {
    /// The network that does it.
    type Network;

    /// Binds weights.
    ///
    /// # Errors
    /// If a weight is missing, extra, misshapen or not finite.
    fn bind(weights: &Weights) -> Result<Self::Network, WeightsError>;
}

/// The network of a task, ready to look.
pub struct Reader<T: Task> {
    pub(crate) network: T::Network,
    digest: Digest,
}

impl<T: Task> Reader<T> {
    /// Binds weights.
    ///
    /// # Errors
    /// If a weight is missing, extra, misshapen or not finite.
    pub fn new(weights: &Weights) -> Result<Self, PerceptionError> {
        Ok(Self { network: T::bind(weights)?, digest: weights.digest() })
    }

    /// Reads a weights file.
    ///
    /// # Errors
    /// If the file is broken or does not hold this network.
    pub fn load(path: &Path) -> Result<Self, PerceptionError> {
        Self::new(&WeightsFile::read(path).map_err(PerceptionError::file(path))?.weights)
    }

    /// Returns the digest of the weights.
    #[must_use]
    pub fn digest(&self) -> Digest {
        self.digest
    }
}

//! The networks that look at frames, loaded once.

use std::path::Path;

use ds_perception::lights::LightReader;
use ds_perception::look::LookReader;
use ds_perception::segmenter::Segmenter;
use ds_space::{Digest, DigestWriter};

use crate::config::EvalConfig;
use crate::error::EvaluationError;

/// All networks.
pub struct Eyes {
    /// Names pixels.
    pub segmenter: Segmenter,
    /// Reads traffic lights.
    pub lights: LightReader,
    /// Says what a frame looks like.
    pub look: LookReader,
    digest: Digest,
}

impl Eyes {
    /// Loads the networks of a configuration.
    ///
    /// # Errors
    /// If a file is broken or does not hold its network.
    pub fn load(config: &EvalConfig) -> Result<Self, EvaluationError> {
        let files = &config.perception;
        let path = |file: &Path| config.path(file);
        let segmenter = Segmenter::load(&path(&files.segmenter))?;
        let lights = LightReader::load(&path(&files.lights))?;
        Ok(Self::new(segmenter, lights, LookReader::load(&path(&files.look))?))
    }

    /// Puts networks together.
    #[must_use]
    pub fn new(segmenter: Segmenter, lights: LightReader, look: LookReader) -> Self {
        let digest =
            DigestWriter::new().digest(&segmenter.digest()).digest(&lights.digest()).digest(&look.digest()).finish();
        Self { segmenter, lights, look, digest }
    }

    /// Returns the digest of all weights.
    #[must_use]
    pub fn digest(&self) -> Digest {
        self.digest
    }
}

//! Networks that were given for FID and FVD: what they see in the frames of a scenario.
//!
//! FID is of a network of single frames, FVD of one of clips. Their distances are plain, in the features' own unit, as
//! published ones are; nothing else has their names.

use std::error::Error;
use std::path::Path;

use ds_onnx::Encoder;
use ds_raster::RgbImage;
use ds_space::Digest;

use super::config::StudyConfig;
use crate::error::EvaluationError;

/// The name of the network of single frames, and of its distance.
const FID: &str = "fid";

/// A network; copies share it.
#[derive(Clone)]
pub(crate) struct Given {
    pub(crate) name: &'static str,
    encoder: Encoder,
}

/// Loads the networks that a configuration names.
///
/// # Errors
/// If a manifest or its network does not fit, or sees as many frames as the other's should.
pub(crate) fn load(config: &StudyConfig) -> Result<Vec<Given>, EvaluationError> {
    let named = [(FID, &config.fid), ("fvd", &config.fvd)];
    named.into_iter().filter_map(|(name, manifest)| Some(one(name, &config.path(manifest.as_ref()?)))).collect()
}

fn one(name: &'static str, manifest: &Path) -> Result<Given, EvaluationError> {
    let refuse = |rule: String| EvaluationError::config(name, format!("{}: {rule}", manifest.display()));
    let encoder = Encoder::read(manifest).map_err(|error| {
        let cause = error.source().map(|source| format!(": {source}")).unwrap_or_default();
        refuse(format!("{error}{cause}"))
    })?;
    match (name == FID, encoder.frames()) {
        (true, 1) | (false, 2..) => Ok(Given { name, encoder }),
        (true, frames) => Err(refuse(format!("image.history is {frames}, FID is of single frames"))),
        (false, _) => Err(refuse("image.history is 1, FVD is of clips of two frames or more".to_owned())),
    }
}

/// Checks that scenarios hold as many clips as a distance needs.
///
/// # Errors
/// If they do not.
pub(crate) fn check(given: &[Given], config: &StudyConfig) -> Result<(), EvaluationError> {
    let few = |given: &&Given| config.scenarios / 2 * (u64::from(config.frames) / given.frames() as u64) < 2;
    given.iter().find(few).map_or(Ok(()), |given| {
        let (clip, frames) = (given.frames(), config.frames);
        let rule = format!("sees {clip} frames at once, scenarios have {frames}: half of them must hold 2 clips");
        Err(EvaluationError::config(given.name, rule))
    })
}

impl Given {
    /// Returns the digest of manifest and network.
    pub(crate) fn digest(&self) -> Digest {
        self.encoder.digest()
    }

    /// Returns how many frames it sees at once.
    pub(crate) fn frames(&self) -> usize {
        self.encoder.frames()
    }

    /// Returns its features: a row for each frame that policies look at, or for each whole clip of all frames.
    ///
    /// # Errors
    /// If it fails or gives a feature that is not finite; `whose` names the frames.
    pub(crate) fn rows(
        &self,
        looked: &[&RgbImage],
        all: &[RgbImage],
        whose: &str,
    ) -> Result<Vec<Vec<f64>>, EvaluationError> {
        let refuse =
            |source| EvaluationError::Given { network: self.name.to_owned(), frames: whose.to_owned(), source };
        let look = |frames: &[&RgbImage]| self.encoder.look(frames).map_err(refuse);
        if self.name == FID {
            return looked.iter().map(|frame| look(&[*frame])).collect();
        }
        all.chunks_exact(self.frames()).map(|clip| look(&clip.iter().collect::<Vec<_>>())).collect()
    }
}

//! A network of others that only looks: frames → one vector of features.
//!
//! Its manifest has the tables `[network]`, `[image]` and `[feature]`. A network of clips sees `history` frames at once. The
//! output is one vector, whatever its sides; tokens are not pooled here.

use std::path::{Path, PathBuf};

use ds_raster::RgbImage;
use ds_space::{Digest, DigestWriter};
use serde::Deserialize;

use crate::error::OnnxError;
use crate::form;
use crate::manifest::{Camera, FeatureSection, ImageSection};
use crate::network::{Named, Network};

/// No network gives more features: a distance needs more frames than features.
const MOST_FEATURES: usize = 4_096;

/// Turns frames into features; copies share the network.
#[derive(Debug, Clone)]
pub struct Encoder {
    image: ImageSection,
    output: String,
    network: Network,
    digest: Digest,
    path: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Form {
    version: u32,
    network: NetworkSection,
    image: ImageSection,
    feature: FeatureSection,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct NetworkSection {
    /// Beside the manifest.
    file: PathBuf,
    /// The digest of the network, if it is to be no other.
    digest: Option<String>,
}

impl Encoder {
    /// Reads a manifest and its network.
    ///
    /// # Errors
    /// [`OnnxError`] names the field, input or output that does not fit, and a file that is not there.
    pub fn read(manifest: &Path) -> Result<Self, OnnxError> {
        let (Form { version, network: section, image, feature }, digest) = form::read(manifest)?;
        let refuse = |field: &str, problem: String| OnnxError::Field { field: field.to_owned(), problem };
        if version != form::VERSION {
            return Err(refuse("version", format!("is {version}, known is {}", form::VERSION)));
        }
        if image.camera != Camera::Known {
            return Err(refuse("image.camera", "is of policies: this network is shown whole frames".to_owned()));
        }
        image.check().map_err(|(field, problem)| refuse(field, problem))?;
        let file = manifest.with_file_name(&section.file);
        let input = Named { name: image.input.clone(), shape: image.shape() };
        let network = Network::read(&file, &[input], std::slice::from_ref(&feature.output))?;
        form::meant(&file, &network, section.digest.as_ref())?;
        let path = file.display().to_string();
        let count: usize = network.outputs()[0].iter().product();
        if !(1..=MOST_FEATURES).contains(&count) {
            let problem =
                format!("output {:?} holds {count} numbers, 1 to {MOST_FEATURES} are features", feature.output);
            return Err(OnnxError::Shape { path, problem });
        }
        let mut writer = DigestWriter::new();
        let digest = writer.digest(&digest).digest(network.digest()).finish();
        Ok(Self { image, output: feature.output, network, digest, path })
    }

    /// Returns how many frames the network sees at once.
    #[must_use]
    pub fn frames(&self) -> usize {
        self.image.history as usize
    }

    /// Returns how many features it gives.
    #[must_use]
    pub fn features(&self) -> usize {
        self.network.outputs()[0].iter().product()
    }

    /// Returns the digest of manifest and network.
    #[must_use]
    pub fn digest(&self) -> Digest {
        self.digest
    }

    /// Returns the features of [`Encoder::frames`] frames of any size, oldest first.
    ///
    /// # Errors
    /// [`OnnxError::Compute`] if the library fails or a feature is not finite.
    ///
    /// # Panics
    /// If there are fewer or more frames.
    pub fn look(&self, frames: &[&RgbImage]) -> Result<Vec<f64>, OnnxError> {
        let sized: Vec<RgbImage> = frames.iter().map(|frame| self.image.sized(frame)).collect();
        let features = self.network.answer(&[self.image.array(&sized)])?.swap_remove(0).into_values();
        if let Some(at) = features.iter().position(|value| !value.is_finite()) {
            let why = format!("number {at} of output {:?} is {}", self.output, features[at]);
            return Err(OnnxError::Compute { path: self.path.clone(), doing: "gives no features", why });
        }
        Ok(features.into_iter().map(f64::from).collect())
    }
}

#[cfg(test)]
mod tests;

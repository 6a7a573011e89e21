//! The segmenter: names what each pixel of a frame shows, so that generated frames can be compared with the truth.
//!
//! It sees one frame and never a layout or a map. Labels are those of [`Label`].

use std::path::Path;

use ds_graph::segmenter;
use ds_nn::safetensors::WeightsFile;
use ds_nn::{Array, Weights};
use ds_raster::RgbImage;
use ds_space::Digest;

use crate::error::PerceptionError;
use crate::label::Label;

/// The network, ready to name pixels.
pub struct Segmenter {
    network: segmenter::Segmenter,
    digest: Digest,
}

impl Segmenter {
    /// Binds weights.
    ///
    /// # Errors
    /// If a weight is missing, extra, misshapen or not finite.
    pub fn new(weights: &Weights) -> Result<Self, PerceptionError> {
        Ok(Self { network: segmenter::Segmenter::new(Label::COUNT, weights)?, digest: weights.digest() })
    }

    /// Reads a weights file.
    ///
    /// # Errors
    /// If the file is broken or does not hold a segmenter.
    pub fn load(path: &Path) -> Result<Self, PerceptionError> {
        Self::new(&WeightsFile::read(path).map_err(PerceptionError::file(path))?.weights)
    }

    /// Returns the digest of the weights.
    #[must_use]
    pub fn digest(&self) -> Digest {
        self.digest
    }

    /// Names every pixel, rows top to bottom.
    ///
    /// # Panics
    /// If a side is no multiple of 16.
    #[must_use]
    pub fn labels(&self, frame: &RgbImage) -> Vec<Label> {
        let scores = self.network.scores(&values_of(frame));
        scores.values().chunks_exact(Label::COUNT).map(|scores| Label::ALL[highest(scores)]).collect()
    }
}

/// Returns what a network takes: [1, height, width, 3] values, −1 to 1.
pub(crate) fn values_of(frame: &RgbImage) -> Array {
    Array::new(&[1, frame.height_px() as usize, frame.width_px() as usize, 3], frame.values().collect())
}

/// Returns the index of the highest score, the first of equal ones.
pub(crate) fn highest(scores: &[f32]) -> usize {
    let mut best = 0;
    for (index, score) in scores.iter().enumerate() {
        if *score > scores[best] {
            best = index;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_scores_give_the_first() {
        assert_eq!(highest(&[0.0, 2.0, 2.0, 1.0]), 1);
        assert_eq!(highest(&[f32::NAN, 2.0]), 0);
    }
}

//! The segmenter: names what each pixel of a frame shows, so that generated frames can be compared with the truth.
//!
//! It sees one frame and never a layout or a map. Labels are those of [`Label`].

use ds_graph::segmenter;
use ds_nn::{Array, Weights, WeightsError};
use ds_raster::RgbImage;

use crate::label::Label;
use crate::reader::{Reader, Task};

/// Naming what each pixel of a frame shows.
pub struct Labels;

impl Task for Labels {
    type Network = segmenter::Segmenter;

    fn bind(weights: &Weights) -> Result<Self::Network, WeightsError> {
        segmenter::Segmenter::new(Label::COUNT, weights)
    }
}

/// The network, ready to name pixels.
pub type Segmenter = Reader<Labels>;

impl Segmenter {
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
pub fn highest(scores: &[f32]) -> usize {
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

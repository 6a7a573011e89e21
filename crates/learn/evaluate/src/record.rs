//! What the networks say of the chosen frames of one rollout: what is stored and summed up.

use ds_perception::overlap::{Overlap, Overlaps, Target};
use serde::{Deserialize, Serialize};

use ds_train::colour::{Colour, Steps};

/// Pixels of every target: in both maps, in either.
pub type Pixels = [[u64; 2]; Target::ALL.len()];

/// One look at a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Glance {
    /// The frame; 0 is the given first one.
    pub frame: u32,
    /// Pixels of each target against the truth.
    pub pixels: Option<Pixels>,
    /// Traffic lights: distance in metres, whether its state was read right.
    pub lights: Vec<(f64, bool)>,
    /// Features for distances between sets of frames.
    pub features: Vec<f32>,
    /// Probabilities of each lighting, weather and road surface.
    pub axes: [Vec<f32>; 3],
    /// Colour statistics.
    pub colour: Colour,
    /// Steps of luma at borders of blocks and inside them.
    pub steps: Steps,
    /// Peak signal-to-noise ratio against the world's own frame, in decibels.
    pub psnr_db: Option<f64>,
    /// Perceptual distance from the world's own frame.
    pub distance: Option<f64>,
    /// The same where the truth shows neither road nor road users nor sky: houses, trees, verges.
    pub off_road: Option<f64>,
}

impl Glance {
    /// Returns the pixels of each target.
    #[must_use]
    pub fn overlaps(&self) -> Overlaps {
        let mut overlaps = Overlaps::default();
        if let Some(pixels) = &self.pixels {
            for (overlap, [both, either]) in overlaps.0.iter_mut().zip(pixels) {
                *overlap = Overlap { both: *both, either: *either };
            }
        }
        overlaps
    }
}

/// Sums of mean differences between successive frames.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Seam {
    /// Across the borders of chunks.
    pub across: f64,
    /// How many.
    pub borders: u32,
    /// Inside chunks.
    pub inside: f64,
    /// How many.
    pub steps: u32,
}

impl Seam {
    /// Returns the mean across borders over the mean inside: 1 without seams.
    #[must_use]
    pub fn ratio(&self) -> Option<f64> {
        let across = self.across / f64::from(self.borders);
        Some(across / (self.inside / f64::from(self.steps))).filter(|ratio| ratio.is_finite())
    }

    /// Adds other frames.
    pub fn merge(&mut self, other: &Self) {
        self.across += other.across;
        self.borders += other.borders;
        self.inside += other.inside;
        self.steps += other.steps;
    }
}

/// One rollout.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// The drive's name.
    pub drive: String,
    /// Looks at the chosen frames, in order.
    pub glances: Vec<Glance>,
    /// Differences between successive frames; zeros for a world's own frames.
    pub seam: Seam,
}

impl Record {
    /// Returns the looks at frames of a range.
    pub fn within(&self, from: u32, to: u32) -> impl Iterator<Item = &Glance> {
        self.glances.iter().filter(move |glance| (from..=to).contains(&glance.frame))
    }
}

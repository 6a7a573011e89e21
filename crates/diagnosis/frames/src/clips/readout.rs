//! What one clip says: the statistics of the real stream beyond each simulated one, and what every effect would do to
//! them, which is tried on the clip's own frames.

use ds_diagnosis::meta::Pairing;
use ds_effect::frame::FrameEffect;
use nalgebra::DVector;

use crate::case::FrameCase;
use crate::clips::Clip;
use crate::error::SightError;
use crate::how_far::plain_gap;
use crate::pairing::paths::{Path, paths};
use crate::pairing::statistics::statistics;
use crate::scene::Scene;
use crate::settings;

/// What a clip says.
pub struct Readout {
    /// Statistics of the real stream beyond each simulated one, a row per seed.
    pub rows: Vec<DVector<f64>>,
    /// Age of the content against each simulated stream: the effect with its value, if any.
    pub late: Vec<Option<(&'static FrameEffect, f64)>>,
    /// What every effect would do.
    pub paths: Vec<Path>,
    /// Root mean square difference and feature distance of the streams as they are, mean over seeds.
    pub gap: [f64; 2],
    /// What looked odd.
    pub warnings: Vec<String>,
}

impl Readout {
    /// Reads a clip; `gap` is what real frames have beyond simulated ones without any effect, without which effects are
    /// not tried.
    ///
    /// # Errors
    /// If a file is missing or spoiled.
    pub fn of(clip: &Clip, gap: Option<&DVector<f64>>, without: &[String]) -> Result<Self, SightError> {
        let streams = clip.streams()?;
        let mut readout =
            Self { rows: Vec::new(), late: Vec::new(), paths: Vec::new(), gap: [0.0; 2], warnings: Vec::new() };
        for stream in &streams {
            let scene = scene(stream);
            let (row, moved) = statistics(&scene, Pairing::SameLayout);
            readout.rows.push(row);
            readout.late.push(moved.and_then(|moved| moved.late.effect));
            for (sum, own) in readout.gap.iter_mut().zip(plain_gap(stream)?) {
                *sum += own / streams.len() as f64;
            }
        }
        let first = &streams[0];
        readout.warnings.clone_from(&first.warnings);
        if let Some(gap) = gap {
            readout.paths = paths(&scene(first), gap, true, without);
        }
        Ok(readout)
    }

    /// Returns the mean of the rows.
    #[must_use]
    pub fn mean(&self) -> DVector<f64> {
        let mut sum = self.rows[0].clone();
        self.rows[1..].iter().for_each(|row| sum += row);
        sum / self.rows.len() as f64
    }
}

/// Makes the frames of a stream ready, more of them in full size than of a case of one pair.
fn scene(case: &FrameCase) -> Scene<'_> {
    let mut scene = Scene::new(case);
    let count = settings::CLIP_FULL_FRAMES.min(scene.frames.len());
    scene.full = (0..count).map(|k| (2 * k + 1) * scene.frames.len() / (2 * count)).collect();
    scene
}

//! The segmenter: names what each pixel of a frame shows, so that generated frames can be compared with the truth.
//!
//! Trained on frames of the reference camera with its own class maps, over generated scenarios in drawn light and
//! weather; frames are softened and made noisy, so that it also reads frames a little less sharp. It sees one frame and
//! never a layout or a map. Classes are those of [`PixelClass`].

pub mod frames;
pub mod overlap;

use std::path::Path;

use ds_camera::PixelClass;
use ds_nn::optimiser::{AdamW, AdamWSettings, Schedule, move_average};
use ds_nn::safetensors::WeightsFile;
use ds_nn::{Array, Weights, segmenter};
use ds_raster::RgbImage;
use ds_space::{DigestWriter, Draws};
use ds_video::pixels;
use serde::{Deserialize, Serialize};

use crate::Progress;
use crate::error::TrainError;
use frames::Labelled;
use overlap::Overlaps;

/// All classes, in the order of the network's scores.
pub const CLASSES: [PixelClass; PixelClass::COUNT] =
    [PixelClass::Road, PixelClass::Paint, PixelClass::Vehicle, PixelClass::Person, PixelClass::Other, PixelClass::Sky];

/// How much a pixel of each class counts in the loss: thin and small things more, for they have few pixels.
const CLASS_WEIGHTS: [f32; PixelClass::COUNT] = [1.0, 2.0, 2.0, 4.0, 1.0, 1.0];

/// Decay of the averaged weights.
const AVERAGE_DECAY: f32 = 0.99;

/// The recipe of a segmenter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SegmenterSettings {
    /// Schema version, 1.
    pub version: u32,
    /// Keys all draws.
    pub seed: u64,
    /// Width of the frames, in pixels.
    pub width_px: u32,
    /// Height of the frames, in pixels.
    pub height_px: u32,
    /// Scenarios to train on; the families take turns.
    pub scenarios: u64,
    /// Scenarios to measure on.
    pub held_out_scenarios: u64,
    /// Frames of a scenario.
    pub frames: u64,
    /// Updates.
    pub steps: u32,
    /// Frames of a batch.
    pub batch: u64,
    /// Highest learning rate.
    pub learning_rate: f32,
    /// Updates until the highest rate.
    pub warm_up: u32,
}

impl SegmenterSettings {
    /// Reads and checks a recipe.
    ///
    /// # Errors
    /// If a key is unknown or a value is out of bounds.
    pub fn parse(text: &str) -> Result<Self, TrainError> {
        let settings: Self = toml::from_str(text)?;
        let refuse = |field, rule: &str| Err(TrainError::Config { field, rule: rule.to_owned() });
        let side = |px: u32| (8..=2_048).contains(&px) && px.is_multiple_of(segmenter::SIDE_PX as u32);
        if settings.version != 1 {
            return refuse("version", "must be 1");
        }
        if !side(settings.width_px) || !side(settings.height_px) {
            return refuse("width_px", "both sides must be multiples of 8 from 8 to 2048");
        }
        let counts = [settings.scenarios, settings.held_out_scenarios, settings.frames, settings.batch];
        if counts.iter().any(|count| !(1..=10_000).contains(count)) {
            return refuse("scenarios", "scenarios, held_out_scenarios, frames and batch must be 1 to 10000");
        }
        if !(settings.learning_rate > 0.0 && settings.learning_rate < 1.0) || settings.steps == 0 {
            return refuse("learning_rate", "must lie within (0, 1), with at least one step");
        }
        Ok(settings)
    }
}

/// The network, ready to name pixels.
pub struct Segmenter {
    network: segmenter::Segmenter,
}

impl Segmenter {
    /// Binds weights.
    ///
    /// # Errors
    /// If a weight is missing, extra, misshapen or not finite.
    pub fn new(weights: &Weights) -> Result<Self, TrainError> {
        Ok(Self { network: segmenter::Segmenter::new(CLASSES.len(), weights)? })
    }

    /// Reads a weights file.
    ///
    /// # Errors
    /// If the file is broken or does not hold a segmenter.
    pub fn load(path: &Path) -> Result<Self, TrainError> {
        Self::new(&WeightsFile::read(path)?.weights)
    }

    /// Names every pixel, rows top to bottom.
    ///
    /// # Panics
    /// If a side is no multiple of 8.
    #[must_use]
    pub fn classes(&self, frame: &RgbImage) -> Vec<PixelClass> {
        let scores = self.network.scores(&pixels::to_values(&[frame]));
        scores.values().chunks_exact(CLASSES.len()).map(best).collect()
    }
}

/// Returns the class of the highest score, the first of equal ones.
fn best(scores: &[f32]) -> PixelClass {
    let mut best = 0;
    for (class, score) in scores.iter().enumerate() {
        if *score > scores[best] {
            best = class;
        }
    }
    CLASSES[best]
}

/// A trained segmenter with what it scored on frames that it has not seen.
pub struct Trained {
    /// The averaged weights with the recipe in the metadata.
    pub file: WeightsFile,
    /// On held-out frames as rendered.
    pub sharp: Overlaps,
    /// On the same frames, softened as in training.
    pub soft: Overlaps,
}

/// Trains a segmenter from draws; the same settings give the same weights.
///
/// # Errors
/// If the loss is not finite.
pub fn train(settings: &SegmenterSettings, progress: &mut dyn Progress) -> Result<Trained, TrainError> {
    let seed = DigestWriter::new().text("segmenter").u64(settings.seed).finish();
    progress.note("rendering frames");
    let frames = frames::of(settings, frames::FIRST_TRAINING_SEED, settings.scenarios);
    progress.note(&format!("{} frames rendered", frames.len()));
    let mut weights = Weights::initialised(&segmenter::declare(CLASSES.len()), &seed);
    let mut average = weights.clone();
    let mut optimiser = AdamW::new(AdamWSettings::default(), &weights);
    let schedule = Schedule { peak: settings.learning_rate, warm_up: settings.warm_up, total: settings.steps };
    for step in 0..settings.steps {
        let (images, labels) = batch(settings, &frames, step, &seed);
        let grade = |scores: &Array| cross_entropy(scores, &labels);
        let (loss, gradient) = segmenter::gradient(CLASSES.len(), &weights, &images, grade)?;
        #[expect(clippy::cast_possible_truncation, reason = "a figure for people")]
        let loss = loss as f32;
        let norm = optimiser.update(&mut weights, &gradient, schedule.rate(step));
        if !loss.is_finite() || !norm.is_finite() {
            return Err(TrainError::Diverged { step, loss });
        }
        let decay = AVERAGE_DECAY.min((1 + step) as f32 / (10 + step) as f32);
        move_average(&mut average, &weights, decay);
        progress.step(step + 1, settings.steps, loss, &[]);
    }
    let (sharp, soft) = held_out(settings, &Segmenter::new(&average)?);
    let metadata = [
        ("command", "train-segmenter configs/train/segmenter.toml configs/models/segmenter.safetensors".to_owned()),
        ("settings", format!("{:#}", serde_json::json!(settings))),
        ("licence", "Apache-2.0".to_owned()),
    ];
    let metadata = metadata.into_iter().map(|(key, value)| (key.to_owned(), value)).collect();
    Ok(Trained { file: WeightsFile { weights: average, metadata }, sharp, soft })
}

/// Measures a segmenter on held-out frames: as rendered, and softened.
#[must_use]
pub fn held_out(settings: &SegmenterSettings, segmenter: &Segmenter) -> (Overlaps, Overlaps) {
    let (mut sharp, mut soft) = (Overlaps::default(), Overlaps::default());
    let frames = frames::of(settings, frames::FIRST_HELD_OUT_SEED, settings.held_out_scenarios);
    for (index, frame) in (0..).zip(&frames) {
        sharp.add(&frame.classes, &segmenter.classes(&frame.image));
        let values = frames::softened(&frame.image, &Draws::from_seed(index, "held-out softness"));
        let image = pixels::to_image(&values, frame.image.width_px(), frame.image.height_px());
        soft.add(&frame.classes, &segmenter.classes(&image));
    }
    (sharp, soft)
}

/// Draws a batch: images [N, H, W, 3] and the index of the class of every pixel.
fn batch(settings: &SegmenterSettings, frames: &[Labelled], step: u32, seed: &ds_space::Digest) -> (Array, Vec<u8>) {
    let (width, height) = (settings.width_px as usize, settings.height_px as usize);
    let (mut values, mut labels) = (Vec::new(), Vec::new());
    for slot in 0..settings.batch {
        let draws = Draws::new(seed, "segmenter batch", &[u64::from(step), slot]);
        let frame = &frames[draws.below(1_000, frames.len() as u64) as usize];
        let (mut image, mut classes) = (frames::softened(&frame.image, &draws), frame.labels());
        if draws.uniform(1_001) < 0.5 {
            mirror(&mut image, width * 3, 3);
            mirror(&mut classes, width, 1);
        }
        values.extend(image);
        labels.extend(classes);
    }
    (Array::new(&[settings.batch as usize, height, width, 3], values), labels)
}

/// Reverses the pixels of each row.
fn mirror<T: Copy>(values: &mut [T], row: usize, per_pixel: usize) {
    for row in values.chunks_exact_mut(row) {
        row.reverse();
        row.chunks_exact_mut(per_pixel).for_each(<[T]>::reverse);
    }
}

/// Returns the weighted mean of −log softmax at the true class, and its gradient by the scores.
fn cross_entropy(scores: &Array, labels: &[u8]) -> (f64, Array) {
    let total: f32 = labels.iter().map(|label| CLASS_WEIGHTS[usize::from(*label)]).sum();
    let mut gradient = scores.clone();
    let mut loss = 0.0;
    for (row, label) in gradient.values_mut().chunks_exact_mut(CLASSES.len()).zip(labels) {
        let label = usize::from(*label);
        let weight = CLASS_WEIGHTS[label] / total;
        let top = row.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        row.iter_mut().for_each(|value| *value = (*value - top).exp());
        let sum: f32 = row.iter().sum();
        loss -= f64::from(weight) * f64::from((row[label] / sum).max(1e-12).ln());
        row.iter_mut().for_each(|value| *value *= weight / sum);
        row[label] -= weight;
    }
    (loss, gradient)
}

#[cfg(test)]
mod tests;

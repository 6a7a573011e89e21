//! How well generated frames follow their layouts, measured on held-out scenarios along the logged drive.
//!
//! Each drive is rolled out from the reference camera's first frame three times with the same noise: with its layouts,
//! with the layout switched off (no control, no guide of the decoder: the null condition of training), and with all agents taken out
//! of the layouts. A segmenter names the pixels of the first two; its maps are compared with the reference camera's
//! class maps of the same tick. Where agents truly were, frames with and without agents in the layout should differ.

pub mod drive;
pub mod report;

use std::path::Path;
use std::sync::Arc;

use ds_camera::PixelClass;
use ds_nn::Weights;
use ds_nn::safetensors::WeightsFile;
use ds_raster::RgbImage;
use ds_space::Digest;
use ds_video::{ModelConfig, Rollout, VideoModel};

use crate::Progress;
use crate::error::TrainError;
use crate::segmenter::Segmenter;
use crate::segmenter::overlap::{Overlaps, Target};
use drive::Drive;

/// Channels of a layout as a guided decoder sees it: 2×2 pixels of three colours.
const GUIDE_CHANNELS: usize = 12;

/// What is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Span {
    /// Held-out scenarios; the families take turns.
    pub scenarios: u64,
    /// The first tick that counts.
    pub first_tick: u32,
    /// The last tick that is generated and counts.
    pub last_tick: u32,
}

impl Default for Span {
    fn default() -> Self {
        Self { scenarios: 16, first_tick: 10, last_tick: 80 }
    }
}

/// A video model, with its layout path and with it switched off.
pub struct Models {
    /// The model as trained.
    pub with_layout: Arc<VideoModel>,
    /// The same model whose control latent is always zero.
    pub without_layout: Arc<VideoModel>,
    /// Digest of the weights.
    pub weights_digest: Digest,
}

impl Models {
    /// Binds weights twice.
    ///
    /// # Errors
    /// If the weights do not fit the configuration.
    pub fn new(config: &ModelConfig, weights: &Weights) -> Result<Self, TrainError> {
        let silent = silenced(weights);
        Ok(Self {
            with_layout: Arc::new(VideoModel::new(config, weights)?),
            without_layout: Arc::new(VideoModel::new(config, &silent)?),
            weights_digest: weights.digest(),
        })
    }

    /// Reads a shipped weights file, or the averaged weights so far in the work folder of a training: the student with
    /// the guided decoder if that stage has left one, else with the plain autoencoder.
    ///
    /// # Errors
    /// If a file is broken or does not fit the configuration.
    pub fn load(config: &ModelConfig, path: &Path) -> Result<Self, TrainError> {
        if path.is_dir() {
            let mut config = config.clone();
            config.control.decoder &= path.join("decoder.safetensors").exists();
            // The statistics of the latents are the autoencoder's; a later decoder replaces the rest.
            let decoder = config.control.decoder.then_some(("vae.", "decoder"));
            let mut weights = Weights::default();
            for (prefix, stage) in [("vae.", "autoencoder"), ("dit.", "student")].into_iter().chain(decoder) {
                let file = WeightsFile::read(&path.join(stage).with_extension("safetensors"))?;
                weights.absorb(prefix, &file.weights);
            }
            return Self::new(&config, &weights);
        }
        // Loading checks the digest of the configuration that the file names.
        VideoModel::load(config, path)?;
        Self::new(config, &WeightsFile::read(path)?.weights)
    }
}

/// Returns weights to which every layout is "no layout": control latents are zero, and so is what a guided decoder sees.
fn silenced(weights: &Weights) -> Weights {
    let mut silent = weights.clone();
    for (name, array) in silent.iter_mut() {
        if name.starts_with("dit.control_embedding.") {
            array.values_mut().fill(0.0);
        }
        if name == "vae.decoder.guide.weight" {
            // Each row holds, for each of nine taps, the decoder's own channels and then those of the layout.
            let inputs = array.values().len() / array.shape()[0] / 9;
            for tap in array.values_mut().chunks_exact_mut(inputs) {
                tap[inputs - GUIDE_CHANNELS..].fill(0.0);
            }
        }
    }
    silent
}

/// Mean absolute difference of colour values of the pixels that were added, 0 to 255.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Difference {
    /// Sum over pixels and colours.
    pub sum: u64,
    /// Colour values added.
    pub values: u64,
}

impl Difference {
    /// Returns the mean, none where nothing was added.
    #[must_use]
    pub fn mean(&self) -> Option<f64> {
        (self.values > 0).then(|| self.sum as f64 / self.values as f64)
    }

    fn add(&mut self, a: [u8; 3], b: [u8; 3]) {
        self.sum += a.iter().zip(b).map(|(a, b)| u64::from(a.abs_diff(b))).sum::<u64>();
        self.values += 3;
    }

    /// Adds other pixels.
    pub fn merge(&mut self, other: &Self) {
        self.sum += other.sum;
        self.values += other.values;
    }
}

/// What one drive showed, over the ticks that count.
#[derive(Debug, Clone, PartialEq)]
pub struct DriveMeasured {
    /// The scenario's family.
    pub family: &'static str,
    /// The scenario's seed.
    pub seed: u64,
    /// The segmenter on the reference frames themselves: the most that a generated frame can reach.
    pub reference: Overlaps,
    /// On frames generated with layouts.
    pub with_layout: Overlaps,
    /// On frames generated without.
    pub without_layout: Overlaps,
    /// Change by taking the agents out of the layouts, where vehicles and persons truly were.
    pub inside: Difference,
    /// The same change, everywhere else.
    pub outside: Difference,
}

/// What all drives showed.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    /// The ticks that count.
    pub span: Span,
    /// Digest of the video model's weights.
    pub weights_digest: Digest,
    /// Whether the model's decoder saw the layouts too.
    pub decoder_guided: bool,
    /// One entry per drive.
    pub drives: Vec<DriveMeasured>,
    /// Per drive: reference, layout, generated, layout off, agents taken out; columns are ticks.
    pub sheet: Vec<Vec<RgbImage>>,
}

/// Measures a model. The same inputs give the same figures.
///
/// # Errors
/// If the span is empty, a scenario cannot be rendered or the model gives values that are not finite.
pub fn measure(
    models: &Models,
    segmenter: &Segmenter,
    span: Span,
    progress: &mut dyn Progress,
) -> Result<Measured, TrainError> {
    if span.scenarios == 0 || span.scenarios > 10_000 || span.first_tick == 0 || span.first_tick > span.last_tick {
        let rule = "needs 1 to 10000 scenarios and a first tick from 1 to the last".to_owned();
        return Err(TrainError::Config { field: "span", rule });
    }
    let mut measured = Measured {
        span,
        weights_digest: models.weights_digest,
        decoder_guided: models.with_layout.config().control.decoder,
        drives: Vec::new(),
        sheet: Vec::new(),
    };
    for index in 0..span.scenarios {
        let video = &models.with_layout.config().video;
        let drive = Drive::held_out(index, (video.width_px, video.height_px), span.last_tick)?;
        let own = roll(&models.with_layout, &drive, &drive.layouts)?;
        let off = roll(&models.without_layout, &drive, &drive.layouts)?;
        let bare = roll(&models.with_layout, &drive, &drive.layouts_without_agents)?;
        let found = compare(&drive, [&own, &off, &bare], segmenter, span);
        progress.note(&line(&found));
        measured.drives.push(found);
        let columns = shown_ticks(span);
        for row in [&drive.frames, &drive.layouts, &own, &off, &bare] {
            measured.sheet.push(columns.iter().map(|tick| row[*tick].clone()).collect());
        }
    }
    Ok(measured)
}

/// Rolls a drive out; tick 0 is the given first frame.
fn roll(model: &Arc<VideoModel>, drive: &Drive, layouts: &[RgbImage]) -> Result<Vec<RgbImage>, TrainError> {
    let (first, layout) = (&drive.frames[0], &layouts[0]);
    let (mut rollout, _) = Rollout::new(Arc::clone(model), drive.draw_key, "front", &drive.prompt, first, layout)?;
    let mut frames = vec![drive.frames[0].clone()];
    frames.extend(rollout.generate(&layouts[1..])?.frames);
    Ok(frames)
}

/// Compares generated frames (own layouts, layout off, agents taken out) with the truth.
fn compare(drive: &Drive, generated: [&[RgbImage]; 3], segmenter: &Segmenter, span: Span) -> DriveMeasured {
    let [own, off, bare] = generated;
    let mut found = DriveMeasured {
        family: drive.family,
        seed: drive.seed,
        reference: Overlaps::default(),
        with_layout: Overlaps::default(),
        without_layout: Overlaps::default(),
        inside: Difference::default(),
        outside: Difference::default(),
    };
    for tick in span.first_tick as usize..=span.last_tick as usize {
        let truth = &drive.classes[tick];
        found.reference.add(truth, &segmenter.classes(&drive.frames[tick]));
        found.with_layout.add(truth, &segmenter.classes(&own[tick]));
        found.without_layout.add(truth, &segmenter.classes(&off[tick]));
        differ(truth, &own[tick], &bare[tick], (&mut found.inside, &mut found.outside));
    }
    found
}

/// Adds the difference of two frames inside and outside the agents' pixels.
fn differ(truth: &[PixelClass], a: &RgbImage, b: &RgbImage, (inside, outside): (&mut Difference, &mut Difference)) {
    let pixels = a.rgb().chunks_exact(3).zip(b.rgb().chunks_exact(3));
    for (class, (a, b)) in truth.iter().zip(pixels) {
        let place = if Target::Boxes.holds(*class) { &mut *inside } else { &mut *outside };
        place.add([a[0], a[1], a[2]], [b[0], b[1], b[2]]);
    }
}

/// Returns the ticks of the contact sheet: about six, the first and the last that count among them.
fn shown_ticks(span: Span) -> Vec<usize> {
    let (first, last) = (span.first_tick as usize, span.last_tick as usize);
    let mut ticks: Vec<usize> = (0..6).map(|k| first + k * (last - first) / 5).collect();
    ticks.dedup();
    ticks
}

fn line(found: &DriveMeasured) -> String {
    let iou = |overlaps: &Overlaps, target| overlaps.iou(target).map_or("-".to_owned(), |iou| format!("{iou:.3}"));
    let of = |target| format!("{} / {}", iou(&found.with_layout, target), iou(&found.without_layout, target));
    let (family, seed) = (found.family, found.seed);
    format!("{family} {seed}: lane paint {}, boxes {}", of(Target::LanePaint), of(Target::Boxes))
}

#[cfg(test)]
mod tests;

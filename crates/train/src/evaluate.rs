//! How well rollouts of a model match clips that it has not seen.
//!
//! Each held-out clip is rolled out from its first frame with its own layouts, with the layouts of another clip, and
//! frames are compared with the true ones (PSNR, decibels). Following the layout shows as the first being clearly
//! higher than the second. A sheet shows true frame, generated frame and layout.

use std::sync::Arc;

use ds_camera::Sampling;
use ds_raster::RgbImage;
use ds_space::Digest;
use ds_video::{Rollout, VideoModel};

use crate::batch;
use crate::clips::{Clip, ClipShape, ClipSource};
use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::reference::ReferenceClips;
use crate::{Progress, sheet};

const CLIPS: u64 = 8;

/// Rolls a clip out with the given layouts; the first frame is the clip's own.
///
/// # Errors
/// If the model refuses.
pub fn roll(
    model: &Arc<VideoModel>,
    clip: &Clip,
    layouts: &[RgbImage],
    key: &Digest,
) -> Result<Vec<RgbImage>, TrainError> {
    let (first, layout) = (&clip.frames[0], &layouts[0]);
    let (mut rollout, _) = Rollout::new(Arc::clone(model), *key, "front", &clip.prompt, first, layout)?;
    let mut frames = vec![clip.frames[0].clone()];
    frames.extend(rollout.generate(&layouts[1..])?.frames);
    Ok(frames)
}

/// Evaluates on held-out clips and writes a sheet named after the stage.
pub(crate) fn held_out(
    config: &TrainConfig,
    model: &Arc<VideoModel>,
    stage: &str,
) -> Result<Vec<(String, f32)>, TrainError> {
    let clips = batch::clip_file(config, model.config());
    let (first, count) = batch::held_out(config, &clips);
    let count = count.min(CLIPS);
    let (mut own, mut other, mut rows) = (0.0, 0.0, Vec::new());
    for index in first..first + count {
        let clip = clips.read(index, 0, config.data.frames)?;
        let foreign = clips.read(first + (index - first + 1) % count, 0, config.data.frames)?;
        let key = Digest::of(&index.to_le_bytes());
        let frames = roll(model, &clip, &clip.layouts, &key)?;
        let wrong = roll(model, &clip, &foreign.layouts, &key)?;
        own += batch::psnr_db(&clip.frames[1..], &frames[1..]) / count as f32;
        other += batch::psnr_db(&clip.frames[1..], &wrong[1..]) / count as f32;
        let some = |images: &[RgbImage]| images.iter().step_by(4).cloned().collect::<Vec<_>>();
        rows.extend([some(&clip.frames), some(&frames), some(&clip.layouts)]);
    }
    sheet::write(&config.folder.join(format!("{stage}.png")), &rows)?;
    Ok(vec![("psnr_db".to_owned(), own), ("psnr_other_layout_db".to_owned(), other)])
}

/// Ticks of a long drive: 8 s.
const LONG_FRAMES: usize = 81;
/// Long drives, one per scenario family.
const LONG_CLIPS: u64 = 8;
/// Moves the scenario seeds of evaluation away from those of training.
const EVALUATION_SEED: u64 = 1_000;

/// Rolls the shipped weights out over 8 s of unseen scenarios, one per family, and writes `long.png`.
///
/// Figures per span of ticks: PSNR with the drive's own layouts, with the layouts of another drive, and of repeating
/// the first frame; and the ratio of the generated to the true standard deviation of pixels.
///
/// # Errors
/// If weights or scenarios cannot be used.
pub fn long(config: &TrainConfig, progress: &mut dyn Progress) -> Result<Vec<(String, f32)>, TrainError> {
    let model_config = config.model()?;
    let weights = config.base.join(&config.model).with_extension("safetensors");
    let model = Arc::new(VideoModel::load(&model_config, &weights)?);
    let shape = ClipShape { frames: LONG_FRAMES, ..batch::clip_shape(config, &model_config) };
    let source = ReferenceClips { shape, seed: config.seed + EVALUATION_SEED, sampling: Sampling::Smooth };
    let clips: Vec<Clip> = (0..LONG_CLIPS).map(|index| source.clip(index)).collect::<Result<_, _>>()?;
    let (mut figures, mut rows) = (Vec::new(), Vec::new());
    let mut sums = [[0.0f32; 4]; 3];
    for (index, clip) in clips.iter().enumerate() {
        let other = &clips[(index + 1) % clips.len()];
        let key = Digest::of(&(index as u64).to_le_bytes());
        let own = roll(&model, clip, &clip.layouts, &key)?;
        let foreign = roll(&model, clip, &other.layouts, &key)?;
        let still = vec![clip.frames[0].clone(); LONG_FRAMES];
        for (sums, span) in sums.iter_mut().zip([1..11, 11..41, 41..81]) {
            let truth = &clip.frames[span.clone()];
            for (sum, frames) in sums.iter_mut().zip([&own, &foreign, &still]) {
                *sum += batch::psnr_db(truth, &frames[span.clone()]) / clips.len() as f32;
            }
            sums[3] += deviation(&own[span]) / deviation(truth) / clips.len() as f32;
        }
        let some = |images: &[RgbImage]| [1, 4, 10, 20, 40, 60, 80].map(|tick: usize| images[tick].clone()).to_vec();
        rows.extend([some(&clip.frames), some(&own), some(&clip.layouts)]);
        progress.note(&format!("drive {} of {}", index + 1, clips.len()));
    }
    for (name, sums) in ["ticks_1_10", "ticks_11_40", "ticks_41_80"].iter().zip(sums) {
        for (kind, value) in ["psnr_db", "psnr_other_layout_db", "psnr_still_db", "deviation_ratio"].iter().zip(sums) {
            figures.push((format!("{name}/{kind}"), value));
        }
    }
    sheet::write(&config.folder.join("long.png"), &rows)?;
    Ok(figures)
}

/// Returns the standard deviation of all bytes.
fn deviation(frames: &[RgbImage]) -> f32 {
    let bytes = || frames.iter().flat_map(|frame| frame.rgb()).map(|byte| f64::from(*byte));
    let count = bytes().count() as f64;
    let mean = bytes().sum::<f64>() / count;
    #[expect(clippy::cast_possible_truncation, reason = "a figure for people")]
    let deviation = (bytes().map(|byte| (byte - mean).powi(2)).sum::<f64>() / count).sqrt() as f32;
    deviation
}

//! What the stages share about batches: which clips to draw, latent steps, PSNR.

use ds_raster::RgbImage;
use ds_space::Draws;
use ds_video::ModelConfig;

use crate::clips::{ClipFile, ClipShape};
use crate::config::TrainConfig;
use crate::error::TrainError;

pub(crate) fn clip_shape(config: &TrainConfig, model: &ModelConfig) -> ClipShape {
    ClipShape { frames: config.data.frames, width_px: model.video.width_px, height_px: model.video.height_px }
}

pub(crate) fn clip_file(config: &TrainConfig, model: &ModelConfig) -> ClipFile {
    ClipFile::new(&config.folder.join("clips.raw"), clip_shape(config, model))
}

/// Returns first index and number of the held-out clips: the last ones, or the last tenth of an unfinished file.
pub(crate) fn held_out(config: &TrainConfig, clips: &ClipFile) -> (u64, u64) {
    let train = config.data.clips - config.data.held_out;
    let count = clips.count().min(config.data.clips);
    if count > train { (train, count - train) } else { (count - count.div_ceil(10), count.div_ceil(10)) }
}

/// Draws a clip for training, never a held-out one.
pub(crate) fn training_clip(config: &TrainConfig, clips: &ClipFile, draws: &Draws) -> Result<u64, TrainError> {
    let count = clips.count().min(config.data.clips - config.data.held_out);
    if count == 0 {
        return Err(TrainError::Config { field: "data.clips", rule: "no clips are rendered yet".to_owned() });
    }
    Ok(draws.below(0, count))
}

/// Groups frames into latent steps: the first frame repeated, then `stride_t` at a time.
pub(crate) fn latent_steps(frames: &[RgbImage], stride_t: usize) -> Vec<Vec<&RgbImage>> {
    let first = vec![&frames[0]; stride_t];
    let rest = frames[1..].chunks_exact(stride_t).map(|chunk| chunk.iter().collect());
    std::iter::once(first).chain(rest).collect()
}

/// Returns the peak signal-to-noise ratio over all frames, in decibels.
pub(crate) fn psnr_db(expected: &[RgbImage], found: &[RgbImage]) -> f32 {
    let pairs = expected.iter().zip(found).flat_map(|(a, b)| a.rgb().iter().zip(b.rgb()));
    let (mut sum, mut count) = (0.0, 0.0);
    for (a, b) in pairs {
        sum += (f64::from(*a) - f64::from(*b)).powi(2);
        count += 1.0;
    }
    #[expect(clippy::cast_possible_truncation, reason = "a figure for people")]
    let psnr = (10.0 * (255.0f64.powi(2) * count / f64::max(sum, 1e-9)).log10()) as f32;
    psnr
}

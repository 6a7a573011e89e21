//! How well rollouts of a student match clips that it has not seen.
//!
//! Clips of the recipe's `held_out` set are rolled out from their first frame with their own layouts and with those of
//! another clip, and frames are compared with the true ones (PSNR, decibels). Following the layout shows as the first
//! being clearly higher than the second. A sheet shows true frame, generated frame and layout.

use std::sync::Arc;

use ds_clips::{Clip, ClipSet};
use ds_nn::Weights;
use ds_raster::RgbImage;
use ds_space::Digest;
use ds_video::{Layout, Rollout, VideoModel};

use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::{Progress, batch, sheet, ship};

const CLIPS: usize = 8;

/// Returns the layouts of a clip with their geometry.
#[must_use]
pub fn layouts(clip: &Clip) -> Vec<Layout> {
    (0..clip.layouts.len()).map(|tick| layout(clip, tick)).collect()
}

/// Returns the layout of a tick of a clip with its geometry.
pub(crate) fn layout(clip: &Clip, tick: usize) -> Layout {
    Layout { image: clip.layouts[tick].clone(), geometry: clip.geometry.get(tick).cloned() }
}

/// Rolls a clip out with the given layouts; the first frame is the clip's own.
///
/// # Errors
/// If the model refuses.
pub fn roll(
    model: &Arc<VideoModel>,
    clip: &Clip,
    layouts: &[Layout],
    key: &Digest,
) -> Result<Vec<RgbImage>, TrainError> {
    let (first, layout) = (&clip.frames[0], &layouts[0]);
    let (mut rollout, _) = Rollout::new(Arc::clone(model), *key, "front", &clip.prompt, first, layout)?;
    let mut frames = vec![clip.frames[0].clone()];
    frames.extend(rollout.generate(&layouts[1..])?.frames);
    Ok(frames)
}

/// Evaluates a student on held-out clips and writes a sheet named after the stage; nothing without such a set.
pub(crate) fn held_out(
    config: &TrainConfig,
    student: &Weights,
    stage: &str,
    progress: &mut dyn Progress,
) -> Result<Vec<(String, f32)>, TrainError> {
    let Some(name) = &config.held_out else { return Ok(Vec::new()) };
    let clips = ClipSet::open(config.set(name)?)?;
    let decoder = if stage == "decoder" { "decoder" } else { "autoencoder" };
    let model = Arc::new(ship::assembled(config, student, decoder)?);
    let count = clips.len().min(CLIPS);
    let (mut own, mut other, mut rows) = (0.0, 0.0, Vec::new());
    for index in 0..count {
        let clip = clips.whole(index)?;
        let (own_layouts, foreign) = (layouts(&clip), layouts(&clips.whole((index + 1) % count)?));
        let key = Digest::of(&(index as u64).to_le_bytes());
        let frames = roll(&model, &clip, &own_layouts, &key)?;
        let ticks = frames.len().min(foreign.len());
        let wrong = roll(&model, &clip, &foreign[..ticks], &key)?;
        own += batch::psnr_db(&clip.frames[1..ticks], &frames[1..ticks]) / count as f32;
        other += batch::psnr_db(&clip.frames[1..ticks], &wrong[1..ticks]) / count as f32;
        rows.extend([&clip.frames, &frames, &clip.layouts].map(|images| sheet::excerpt(images)));
        progress.note(&format!("evaluated {} of {count} held-out clips", index + 1));
    }
    sheet::write(&config.folder.join(format!("{stage}.png")), &rows)?;
    Ok(vec![("psnr_db".to_owned(), own), ("psnr_other_layout_db".to_owned(), other)])
}

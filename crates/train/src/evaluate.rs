//! How well rollouts of a model match clips that it has not seen.
//!
//! Each held-out clip is rolled out from its first frame with its own layouts, with the layouts of another clip, and
//! frames are compared with the true ones (PSNR, decibels). Following the layout shows as the first being clearly
//! higher than the second. A sheet shows true frame, generated frame and layout.

use std::sync::Arc;

use ds_raster::RgbImage;
use ds_space::Digest;
use ds_video::{Rollout, VideoModel};

use crate::batch;
use crate::clips::Clip;
use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::sheet;

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

/// Evaluates on held-out clips and writes `student.png`.
pub(crate) fn held_out(config: &TrainConfig, model: &Arc<VideoModel>) -> Result<Vec<(String, f32)>, TrainError> {
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
    sheet::write(&config.folder.join("student.png"), &rows)?;
    Ok(vec![("psnr_db".to_owned(), own), ("psnr_other_layout_db".to_owned(), other)])
}

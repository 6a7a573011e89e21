//! A teacher's clip: sampled from noise over all frames of a window at once, guided by what the layout adds.
//!
//! A clip longer than a window goes on from the last latent of the window before; the start latent stays the first frame.

use ds_nn::Array;
use ds_nn::tiny_ae::Memory;
use ds_raster::RgbImage;
use ds_train::condition::{Condition, latent_steps, noise};
use ds_train::guidance::{Guidance, Teacher};
use ds_video::{VideoModel, tokens};

use crate::drive::Drive;

/// Says why a clip cannot be sampled.
#[derive(Debug, thiserror::Error)]
pub(super) enum TeacherError {
    /// The clip's frames do not make whole latents.
    #[error("a teacher's clip has 1 + k·{stride} frames, not {frames}")]
    Frames {
        /// Frames of a latent.
        stride: usize,
        /// Frames asked for.
        frames: usize,
    },
    /// The model gave a value that is not finite.
    #[error("the clip is not finite")]
    NotFinite,
}

/// How a teacher is sampled.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sampling {
    /// How it is guided.
    pub(super) guidance: Guidance,
    /// Euler steps.
    pub(super) steps: usize,
    /// Latents of a window, the given first one included.
    pub(super) window: usize,
    /// Whether layouts are shown at all.
    pub(super) layouts: bool,
}

/// Samples the frames after the first.
pub(super) fn clip(
    model: &VideoModel,
    teacher: &Teacher,
    drive: &Drive,
    first: &RgbImage,
    layouts: &[RgbImage],
    sampling: Sampling,
) -> Result<Vec<RgbImage>, TeacherError> {
    let config = model.config();
    let ((h, w), z, stride, n) = (config.latent_size(), config.vae.z, config.vae.stride_t, config.dit().tokens());
    if !(layouts.len() - 1).is_multiple_of(stride) || layouts.len() < 1 + stride {
        return Err(TeacherError::Frames { stride, frames: layouts.len() });
    }
    let folded = tokens::fold(&vec![first; stride]);
    let encoded =
        model.autoencoder().encode(&Array::new(&[1, h, w, config.ae().inputs()], folded), &mut Memory::default());
    let encoded = model.normalised(encoded);
    let start = Array::new(&[1, n, 4, z], tokens::to_tokens(encoded.values(), h, w));
    let layout_steps = latent_steps(layouts, stride);
    let mut made = start.values().to_vec();
    let per_window = sampling.window.max(2) - 1;
    for (index, window) in (0u64..).zip(windows(&layout_steps, per_window)) {
        let condition = Condition {
            start: start.values(),
            clean: &made[made.len() - n * 4 * z..],
            layouts: window,
            layout_on: sampling.layouts,
            prompt: &drive.prompt,
        };
        let noise = noise(&drive.draw_key, "teacher noise", &[index], &[1, window.len() - 1, n, 4, z]);
        let batch = condition.batch(config);
        made.extend(teacher.sample(&batch, &noise, sampling.steps, sampling.guidance, &mut |_, _| ()).values());
    }
    decode(model, &made, &layout_steps, sampling.layouts)
}

/// Cuts steps into windows of a given first step and up to `count` more; each begins with the last step of the one before.
fn windows<T>(steps: &[T], count: usize) -> impl Iterator<Item = &[T]> {
    (0..steps.len() - 1).step_by(count).map(move |first| &steps[first..steps.len().min(first + count + 1)])
}

/// Decodes latents: the given first frame's own, then those sampled.
fn decode(
    model: &VideoModel,
    latents: &[f32],
    layouts: &[Vec<&RgbImage>],
    shown: bool,
) -> Result<Vec<RgbImage>, TeacherError> {
    let config = model.config();
    let ((h, w), z, stride) = (config.latent_size(), config.vae.z, config.vae.stride_t);
    let (width, height) = (config.video.width_px, config.video.height_px);
    let latent = h * w * z;
    let (mut memory, mut frames) = (Memory::default(), Vec::new());
    for ((index, step), tokens) in layouts.iter().enumerate().zip(latents.chunks_exact(latent)) {
        let latents = model.denormalised(Array::new(&[1, h, w, z], tokens::from_tokens(tokens, h, w)));
        let guide = (config.control.decoder_layers > 0 && index > 0 && shown).then(|| tokens::stacked(step));
        let decoded = model.autoencoder().decode(&latents, guide.as_ref(), &mut memory);
        if !decoded.is_finite() {
            return Err(TeacherError::NotFinite);
        }
        if index > 0 {
            let images = decoded.values().chunks_exact(width as usize * height as usize * 3).take(stride);
            frames.extend(images.map(|values| RgbImage::of_values(values, width, height)));
        }
    }
    Ok(frames)
}

#[cfg(test)]
mod tests {
    #[test]
    fn windows_overlap_by_the_given_step() {
        let check = |steps: &[u8], count: usize, expected: &[&[u8]]| {
            assert_eq!(super::windows(steps, count).collect::<Vec<_>>(), expected, "{steps:?} by {count}");
        };
        check(&[0, 1, 2, 3, 4], 2, &[&[0, 1, 2], &[2, 3, 4]]);
        check(&[0, 1, 2, 3, 4], 3, &[&[0, 1, 2, 3], &[3, 4]]);
        check(&[0, 1, 2], 5, &[&[0, 1, 2]]);
    }
}

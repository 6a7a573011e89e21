//! A teacher's clip: sampled from noise over all frames of a window at once, guided by what the layout adds.
//!
//! A clip longer than a window goes on from the last latent of the window before; the start latent stays the first frame.

use ds_nn::safetensors::FileError;
use ds_nn::step::ClipBatch;
use ds_nn::tiny_ae::Memory;
use ds_nn::{Array, Weights};
use ds_raster::RgbImage;
use ds_space::Draws;
use ds_train::config::Dropout;
use ds_train::guidance::Teacher;
use ds_video::{VideoModel, pixels, prompt};

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
    /// Weights are refused.
    #[error("weights are refused")]
    File(#[from] FileError),
    /// Weights do not fit the preset.
    #[error("weights do not fit the preset")]
    Weights(#[from] ds_nn::WeightsError),
}

/// How a teacher is sampled.
#[derive(Debug, Clone, Copy)]
pub(super) struct Guidance {
    /// w in G(c∅) + w·(G(c) − G(c∅)).
    pub(super) weight: f32,
    /// Euler steps.
    pub(super) steps: usize,
    /// What c∅ lacks.
    pub(super) dropout: Dropout,
    /// Latents of a window, the given first one included.
    pub(super) window: usize,
    /// Whether layouts are shown at all.
    pub(super) layouts: bool,
}

/// Samples the frames after the first.
pub(super) fn clip(
    model: &VideoModel,
    dit: &Weights,
    drive: &Drive,
    (first, layouts): (&RgbImage, &[RgbImage]),
    guidance: Guidance,
) -> Result<Vec<RgbImage>, TeacherError> {
    let config = model.config();
    let ((h, w), z, stride, n) = (config.latent_size(), config.vae.z, config.vae.stride_t, config.dit().tokens());
    if !(layouts.len() - 1).is_multiple_of(stride) || layouts.len() < 1 + stride {
        return Err(TeacherError::Frames { stride, frames: layouts.len() });
    }
    let steps_of = |images: &[RgbImage]| -> Vec<Vec<RgbImage>> {
        let head = vec![images[0].clone(); stride];
        std::iter::once(head).chain(images[1..].chunks_exact(stride).map(<[RgbImage]>::to_vec)).collect()
    };
    let folded = pixels::fold(&vec![first; stride]);
    let encoded =
        model.autoencoder().encode(&Array::new(&[1, h, w, config.ae().inputs()], folded), &mut Memory::default());
    let encoded = model.normalised(encoded);
    let start = Array::new(&[1, n, 4, z], pixels::to_tokens(encoded.values(), h, w));
    let layout_steps = steps_of(layouts);
    let teacher = Teacher::new(config, dit, guidance.dropout)?;
    let mut made = start.values().to_vec();
    let per_window = guidance.window.max(2) - 1;
    for (index, window) in (0u64..).zip(windows(&layout_steps, per_window)) {
        let latents = window.len();
        let mut clean = made[made.len() - n * 4 * z..].to_vec();
        clean.resize(latents * n * 4 * z, 0.0);
        let tokens: Vec<f32> = window
            .iter()
            .flat_map(|step| pixels::to_tokens(&pixels::fold(&step.iter().collect::<Vec<_>>()), h, w))
            .collect();
        let batch = ClipBatch {
            clean: Array::new(&[1, latents, n, 4, z], clean),
            start: start.clone(),
            layouts: Array::new(&[1, latents * n, 4, config.ae().inputs()], tokens),
            layout_on: vec![f32::from(u8::from(guidance.layouts))],
            given_on: vec![1.0],
            text: prompt::hashed(&drive.prompt, config.model.text_len, config.model.text_dim),
            emphasis: Array::new(&[1, latents, n, 4, 1], vec![1.0; latents * n * 4]),
        };
        let draws = Draws::new(&drive.draw_key, "teacher noise", &[index]);
        let later = [1, latents - 1, n, 4, z];
        #[expect(clippy::cast_possible_truncation, reason = "noise is single precision")]
        let noise = (0..later.iter().product::<usize>() as u64).map(|index| draws.normal(index) as f32).collect();
        let noise = Array::new(&later, noise);
        made.extend(teacher.sample(&batch, &noise, guidance.steps, guidance.weight, &mut |_, _| ()).values());
    }
    decode(model, &made, &layout_steps, guidance.layouts)
}

/// Cuts steps into windows of a given first step and up to `count` more; each begins with the last step of the one before.
fn windows<T>(steps: &[T], count: usize) -> impl Iterator<Item = &[T]> {
    (0..steps.len() - 1).step_by(count).map(move |first| &steps[first..steps.len().min(first + count + 1)])
}

/// Decodes latents: the given first frame's own, then those sampled.
fn decode(
    model: &VideoModel,
    latents: &[f32],
    layouts: &[Vec<RgbImage>],
    shown: bool,
) -> Result<Vec<RgbImage>, TeacherError> {
    let config = model.config();
    let ((h, w), z, stride) = (config.latent_size(), config.vae.z, config.vae.stride_t);
    let (width, height) = (config.video.width_px, config.video.height_px);
    let latent = h * w * z;
    let (mut memory, mut frames) = (Memory::default(), Vec::new());
    for ((index, step), tokens) in layouts.iter().enumerate().zip(latents.chunks_exact(latent)) {
        let latents = model.denormalised(Array::new(&[1, h, w, z], pixels::from_tokens(tokens, h, w)));
        let guide = (config.control.decoder_layers > 0 && index > 0 && shown)
            .then(|| pixels::to_values(&step.iter().collect::<Vec<_>>()));
        let decoded = model.autoencoder().decode(&latents, guide.as_ref(), &mut memory);
        if !decoded.is_finite() {
            return Err(TeacherError::NotFinite);
        }
        if index > 0 {
            let images = decoded.values().chunks_exact(width as usize * height as usize * 3).take(stride);
            frames.extend(images.map(|values| pixels::to_image(values, width, height)));
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

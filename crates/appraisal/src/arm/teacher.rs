//! A teacher's clip: sampled from noise over all its frames at once, guided by what the layout adds.

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
    let latents = 1 + (layouts.len() - 1) / stride;
    let steps_of = |images: &[RgbImage]| -> Vec<Vec<RgbImage>> {
        let head = vec![images[0].clone(); stride];
        std::iter::once(head).chain(images[1..].chunks_exact(stride).map(<[RgbImage]>::to_vec)).collect()
    };
    let folded = pixels::fold(&vec![first; stride]);
    let encoded =
        model.autoencoder().encode(&Array::new(&[1, h, w, config.ae().inputs()], folded), &mut Memory::default());
    let encoded = model.normalised(encoded);
    let start = Array::new(&[1, n, 4, z], pixels::to_tokens(encoded.values(), h, w));
    let mut clean = start.values().to_vec();
    clean.resize(latents * n * 4 * z, 0.0);
    let layout_steps = steps_of(layouts);
    let tokens: Vec<f32> = layout_steps
        .iter()
        .flat_map(|step| pixels::to_tokens(&pixels::fold(&step.iter().collect::<Vec<_>>()), h, w))
        .collect();
    let shape = [1, latents, n, 4, z];
    let batch = ClipBatch {
        clean: Array::new(&shape, clean),
        start,
        layouts: Array::new(&[1, latents * n, 4, config.ae().inputs()], tokens),
        layout_on: vec![1.0],
        given_on: vec![1.0],
        text: prompt::hashed(&drive.prompt, config.model.text_len, config.model.text_dim),
        emphasis: Array::new(&[1, latents, n, 4, 1], vec![1.0; latents * n * 4]),
    };
    let draws = Draws::new(&drive.draw_key, "teacher noise", &[]);
    let later = [1, latents - 1, n, 4, z];
    #[expect(clippy::cast_possible_truncation, reason = "noise is single precision")]
    let noise = (0..later.iter().product::<usize>() as u64).map(|index| draws.normal(index) as f32).collect();
    let teacher = Teacher::new(config, dit, guidance.dropout)?;
    let sampled = teacher.sample(&batch, &Array::new(&later, noise), guidance.steps, guidance.weight, &mut |_, _| ());
    decode(model, &batch.clean, &sampled, &layout_steps)
}

/// Decodes latents: the given first frame's own, then those sampled.
fn decode(
    model: &VideoModel,
    clean: &Array,
    sampled: &Array,
    layouts: &[Vec<RgbImage>],
) -> Result<Vec<RgbImage>, TeacherError> {
    let config = model.config();
    let ((h, w), z, stride) = (config.latent_size(), config.vae.z, config.vae.stride_t);
    let (width, height) = (config.video.width_px, config.video.height_px);
    let latent = h * w * z;
    let (mut memory, mut frames) = (Memory::default(), Vec::new());
    for (index, step) in layouts.iter().enumerate() {
        let (source, at) = if index == 0 { (clean, 0) } else { (sampled, index - 1) };
        let tokens = &source.values()[at * latent..(at + 1) * latent];
        let latents = model.denormalised(Array::new(&[1, h, w, z], pixels::from_tokens(tokens, h, w)));
        let guide = (config.control.decoder_layers > 0 && index > 0).then(|| pixels::to_values(&step.iter().collect::<Vec<_>>()));
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

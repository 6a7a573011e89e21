//! A first frame from layout and prompt alone: the teacher's one-frame mode.
//!
//! The teacher samples one latent after an empty first frame, as `without_first` of its training clips had it, in a world
//! that stands still; the last of the latent's frames is the answer.

use ds_nn::Array;
use ds_nn::step::ClipBatch;
use ds_nn::tiny_ae::Memory;
use ds_raster::RgbImage;
use ds_space::Digest;
use ds_video::{VideoModel, pixels, prompt};

use crate::guidance::Teacher;
use crate::sets::noise;

/// Samples a first frame for a layout in `steps` Euler steps under guidance w; none if it is not finite.
#[must_use]
pub fn first_frame(
    model: &VideoModel,
    teacher: &Teacher<'_>,
    (layout, text): (&RgbImage, &str),
    key: &Digest,
    (steps, w): (usize, f32),
) -> Option<RgbImage> {
    let config = model.config();
    let ((h, w_px), z, stride, n) = (config.latent_size(), config.vae.z, config.vae.stride_t, config.dit().tokens());
    let still = vec![layout; stride];
    let tokens = pixels::to_tokens(&pixels::fold(&still), h, w_px);
    let batch = ClipBatch {
        clean: Array::zeros(&[1, 2, n, 4, z]),
        start: Array::zeros(&[1, n, 4, z]),
        layouts: Array::new(&[1, 2 * n, 4, config.ae().inputs()], tokens.repeat(2)),
        layout_on: vec![1.0],
        given_on: vec![1.0],
        text: prompt::hashed(text, config.model.text_len, config.model.text_dim),
        emphasis: Array::new(&[1, 2, n, 4, 1], vec![1.0; 2 * n * 4]),
    };
    let noise = noise(key, "first frame", &[], &[1, 1, n, 4, z]);
    let sampled = teacher.sample(&batch, &noise, steps, w, &mut |_, _| ());
    let latents = Array::new(&[1, h, w_px, z], pixels::from_tokens(sampled.values(), h, w_px));
    let guide = (config.control.decoder_layers > 0).then(|| pixels::to_values(&still));
    let frames = model.autoencoder().decode(&model.denormalised(latents), guide.as_ref(), &mut Memory::default());
    let frame = frames.values().chunks_exact(frames.values().len() / stride).next_back()?;
    frames.is_finite().then(|| pixels::to_image(frame, config.video.width_px, config.video.height_px))
}

//! A clip outside of any clip set, as the transformer sees it: what it starts from, its layouts and its prompt.

use ds_nn::Array;
use ds_nn::step::ClipBatch;
use ds_raster::RgbImage;
use ds_space::{Digest, Draws};
use ds_video::{ModelConfig, prompt, tokens};

/// What the frames of a clip are conditioned on.
pub struct Condition<'a> {
    /// The latent of the drive's first frame, [tokens, 4, z]; zeros where there is none.
    pub start: &'a [f32],
    /// The clip's first latents, of which the first is given; the others are zeros unless they are known.
    pub clean: &'a [f32],
    /// The layouts of each latent frame.
    pub layouts: &'a [Vec<&'a RgbImage>],
    /// Whether the layouts are shown.
    pub layout_on: bool,
    /// Words for what is to be seen.
    pub prompt: &'a str,
}

impl Condition<'_> {
    /// Makes a batch of one clip in which all pixels count alike.
    #[must_use]
    pub fn batch(&self, config: &ModelConfig) -> ClipBatch {
        let ((h, w), n, z, frames) = (config.latent_size(), config.dit().tokens(), config.vae.z, self.layouts.len());
        let layouts = self.layouts.iter().flat_map(|step| tokens::to_tokens(&tokens::fold(step), h, w)).collect();
        let mut clean = self.clean.to_vec();
        clean.resize(frames * n * 4 * z, 0.0);
        ClipBatch {
            clean: Array::new(&[1, frames, n, 4, z], clean),
            start: Array::new(&[1, n, 4, z], self.start.to_vec()),
            layouts: Array::new(&[1, frames * n, 4, config.ae().inputs()], layouts),
            layout_on: vec![f32::from(u8::from(self.layout_on))],
            given_on: vec![1.0],
            text: prompt::hashed(self.prompt, config.model.text_len, config.model.text_dim),
            emphasis: Array::new(&[1, frames, n, 4, 1], vec![1.0; frames * n * 4]),
        }
    }
}

/// Groups frames into latent steps: the first frame repeated, then `stride_t` at a time.
#[must_use]
pub fn latent_steps(frames: &[RgbImage], stride_t: usize) -> Vec<Vec<&RgbImage>> {
    let first = vec![&frames[0]; stride_t];
    let rest = frames[1..].chunks_exact(stride_t).map(|chunk| chunk.iter().collect());
    std::iter::once(first).chain(rest).collect()
}

/// Draws standard normal noise.
#[must_use]
pub fn noise(seed: &Digest, purpose: &str, key: &[u64], shape: &[usize]) -> Array {
    Array::normal(shape, &Draws::new(seed, purpose, key))
}

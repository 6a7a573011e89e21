//! Clips as the transformer sees them: normalised latents in memory, layouts read from the clip file when needed.

use ds_nn::safetensors::WeightsFile;
use ds_nn::step::ClipBatch;
use ds_nn::tiny_ae::{AeShape, TinyAe};
use ds_nn::{Array, Weights};
use ds_space::{Digest, Draws};
use ds_video::{ModelConfig, pixels, prompt};

use crate::batch::{self, latent_steps};
use crate::checkpoint::Run;
use crate::clips::ClipFile;
use crate::config::{StageConfig, TrainConfig};
use crate::error::TrainError;
use crate::{Progress, autoencoder, emphasis};

/// Share of clips whose layout is dropped, so that the model also knows frames without one.
const LAYOUT_DROPOUT: f64 = 0.1;

/// All clips of a file as normalised latents.
pub(crate) struct LatentClips {
    config: TrainConfig,
    model: ModelConfig,
    clips: ClipFile,
    /// Per clip [latents, tokens, 4, z].
    latents: Vec<Vec<f32>>,
    held_out: (u64, u64),
}

/// Reads the autoencoder as a stage left it; the statistics of its latents come from its own stage.
pub(crate) fn stored_autoencoder(config: &TrainConfig, stage: &str) -> Result<Weights, TrainError> {
    let read = |stage: &str| WeightsFile::read(&Run::weights_path(&config.folder, stage));
    let (mut weights, own) = (read(stage)?.weights, read("autoencoder")?.weights);
    for name in ["latent.mean", "latent.std"] {
        if let Some(array) = own.get(name) {
            weights.insert(name, array.clone());
        }
    }
    Ok(weights)
}

/// Returns the sizes of the autoencoder without the decoder's guidance, as its own stage trains it.
pub(crate) fn unguided(model: &ModelConfig) -> AeShape {
    AeShape { guided: false, ..model.ae() }
}

impl LatentClips {
    /// Encodes every clip of the file.
    pub(crate) fn encode(config: &TrainConfig, progress: &mut dyn Progress) -> Result<Self, TrainError> {
        let model = config.model()?;
        let clips = batch::clip_file(config, &model);
        let mut weights = stored_autoencoder(config, "autoencoder")?;
        let mut statistic = |name: &str| weights.remove(name).map(Array::into_values).unwrap_or_default();
        let (mean, std) = (statistic("latent.mean"), statistic("latent.std"));
        if mean.len() != model.vae.z || std.len() != model.vae.z {
            let path = Run::weights_path(&config.folder, "autoencoder").display().to_string();
            let reason = "it has no latent statistics: its stage did not end".to_owned();
            return Err(TrainError::Checkpoint { path, reason });
        }
        let ae = TinyAe::new(&unguided(&model), &weights)?;
        let (h, w) = model.latent_size();
        let mut latents = Vec::new();
        for index in 0..clips.count().min(config.data.clips) {
            let clip = clips.read(index, 0, config.data.frames)?;
            let mut encoded = autoencoder::encode(&ae, &model.ae(), &clip);
            for pixel in encoded.values_mut().chunks_exact_mut(model.vae.z) {
                pixel.iter_mut().zip(mean.iter().zip(&std)).for_each(|(value, (mean, std))| {
                    *value = (*value - mean) / std;
                });
            }
            let frames = encoded.values().chunks_exact(h * w * model.vae.z);
            latents.push(frames.flat_map(|frame| pixels::to_tokens(frame, h, w)).collect());
            if (index + 1).is_multiple_of(100) {
                progress.note(&format!("encoded {} clips", index + 1));
            }
        }
        let held_out = batch::held_out(config, &clips);
        Ok(Self { config: config.clone(), model, clips, latents, held_out })
    }

    /// Draws a training batch of a stage.
    pub(crate) fn batch(&self, stage: &StageConfig, seed: &Digest, step: u32) -> Result<ClipBatch, TrainError> {
        let (n, z) = (self.model.dit().tokens(), self.model.vae.z);
        let (frame, stride) = (n * 4 * z, self.model.vae.stride_t);
        let all = (self.config.data.frames - 1) / stride + 1;
        let latents = stage.latents.min(all);
        let train = self.held_out.0.max(1);
        let (mut clean, mut layouts, mut on, mut text) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mut weights = Vec::new();
        for index in 0..stage.clips {
            let draws = Draws::new(seed, "batch", &[u64::from(step), index as u64]);
            let clip = draws.below(0, train);
            // Frame 0 is a latent of a single frame, so every training sequence begins with the clip.
            clean.extend_from_slice(&self.latents[clip as usize][..latents * frame]);
            let clip = self.clips.read(clip, 0, 1 + (latents - 1) * stride)?;
            layouts.extend(self.layout_tokens(&clip.layouts));
            weights.extend(self.emphasis_tokens(&clip.layouts));
            on.push(f32::from(u8::from(draws.uniform(1) >= LAYOUT_DROPOUT)));
            text.extend(
                prompt::hashed(&clip.prompt, self.model.model.text_len, self.model.model.text_dim).into_values(),
            );
        }
        let b = stage.clips;
        Ok(ClipBatch {
            clean: Array::new(&[b, latents, n, 4, z], clean),
            layouts: Array::new(&[b, latents * n, 4, self.model.ae().inputs()], layouts),
            layout_on: on,
            text: Array::new(&[b, self.model.model.text_len, self.model.model.text_dim], text),
            emphasis: Array::new(&[b, latents, n, 4, 1], weights),
        })
    }

    fn emphasis_tokens(&self, layouts: &[ds_raster::RgbImage]) -> Vec<f32> {
        let (h, w) = self.model.latent_size();
        let weights = |step: &Vec<&ds_raster::RgbImage>| emphasis::of_latents(step, self.config.data.road_users);
        let steps = latent_steps(layouts, self.model.vae.stride_t);
        steps.iter().flat_map(|step| pixels::to_tokens(&weights(step), h, w)).collect()
    }

    fn layout_tokens(&self, layouts: &[ds_raster::RgbImage]) -> Vec<f32> {
        let (h, w) = self.model.latent_size();
        let steps = latent_steps(layouts, self.model.vae.stride_t);
        steps.iter().flat_map(|step| pixels::to_tokens(&pixels::fold(step), h, w)).collect()
    }
}

/// Draws standard normal noise.
pub(crate) fn noise(seed: &Digest, purpose: &str, step: u32, shape: &[usize]) -> Array {
    let draws = Draws::new(seed, purpose, &[u64::from(step)]);
    #[expect(clippy::cast_possible_truncation, reason = "noise is single precision")]
    let values = (0..shape.iter().product::<usize>() as u64).map(|i| draws.normal(i) as f32).collect();
    Array::new(shape, values)
}

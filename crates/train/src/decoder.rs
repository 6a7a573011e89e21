//! The last stage: the decoder learns to draw from what the student generates, guided by the layouts.
//!
//! Encoder and student stay as they are. Most clips of a batch are latents of the student's own rollouts over training
//! clips, the rest are encoded frames; the target is always the true frame. Layouts are dropped now and then.

use std::sync::Arc;

use ds_nn::Array;
use ds_nn::safetensors::WeightsFile;
use ds_nn::step::{self, DecoderBatch};
use ds_space::{Digest, DigestWriter, Draws};
use ds_video::{ModelConfig, Rollout, VideoModel, pixels};

use crate::batch::{self, latent_steps};
use crate::checkpoint::Run;
use crate::clips::{Clip, ClipFile};
use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::latents::{stored_autoencoder, unguided};
use crate::{Progress, Report, autoencoder, emphasis, evaluate, student};

const NAME: &str = "decoder";
const LAYOUT_DROPOUT: f64 = 0.1;
/// Share of clips that are the student's rollouts.
const ROLLED: f64 = 0.7;

/// Trains the guided decoder to its configured number of steps.
///
/// # Errors
/// If autoencoder or student are not trained, a file cannot be used or the loss is not finite.
pub fn run(config: &TrainConfig, progress: &mut dyn Progress) -> Result<Report, TrainError> {
    let model = config.model()?;
    let clips = batch::clip_file(config, &model);
    let seed = DigestWriter::new().text(NAME).u64(config.seed).finish();
    let mut declared = model.ae().declare();
    declared.sort_by(|a, b| a.name.cmp(&b.name));
    let mut run = Run::open(&config.folder, NAME, &config.decoder, &declared, &seed)?;
    run.start_from(&stored_autoencoder(config, "autoencoder")?);
    run.start_from(&config.initial("vae.")?);
    if run.unfinished() {
        let stored = WeightsFile::read(&Run::weights_path(&config.folder, "student"))?.weights;
        let drawn = Arc::new(student::assembled(config, &stored, "autoencoder")?);
        let rolled = roll(config, &clips, &drawn, progress)?;
        while run.unfinished() {
            let batch = self::batch(config, &clips, &drawn, &rolled, (&seed, run.step))?;
            let step = step::decoder(&model.ae(), &run.weights, &batch);
            if !run.apply(&step, progress)? {
                break;
            }
        }
    }
    let stored = WeightsFile::read(&Run::weights_path(&config.folder, "student"))?.weights;
    let figures = evaluate::held_out(config, &Arc::new(student::assembled(config, &stored, NAME)?), NAME)?;
    Ok(run.report(figures))
}

/// Rolls the student out over the first training clips; latents [latents, h, w, z] as the decoder takes them.
fn roll(
    config: &TrainConfig,
    clips: &ClipFile,
    model: &Arc<VideoModel>,
    progress: &mut dyn Progress,
) -> Result<Vec<Array>, TrainError> {
    let (h, w) = model.config().latent_size();
    let count = config.data.rollouts.min(batch::held_out(config, clips).0);
    let mut rolled = Vec::new();
    for index in 0..count {
        let clip = clips.read(index, 0, config.data.frames)?;
        let key = Digest::of(&index.to_le_bytes());
        let (first, layout) = (&clip.frames[0], &clip.layouts[0]);
        let (mut rollout, entry) = Rollout::new(Arc::clone(model), key, "front", &clip.prompt, first, layout)?;
        let mut entries = vec![entry];
        entries.extend(rollout.generate(&clip.layouts[1..])?.committed);
        let frame = h * w * model.config().vae.z;
        let frames = entries.iter().flat_map(|entry| entry.clean.values.chunks_exact(frame));
        let values: Vec<f32> = frames.flat_map(|tokens| pixels::from_tokens(tokens, h, w)).collect();
        let latents = Array::new(&[values.len() / frame, h, w, model.config().vae.z], values);
        rolled.push(model.denormalised(latents));
        if (index + 1).is_multiple_of(40) {
            progress.note(&format!("rolled out {} clips", index + 1));
        }
    }
    Ok(rolled)
}

fn batch(
    config: &TrainConfig,
    clips: &ClipFile,
    model: &VideoModel,
    rolled: &[Array],
    (seed, step): (&Digest, u32),
) -> Result<DecoderBatch, TrainError> {
    let shape = unguided(model.config());
    let (stage, stride) = (&config.decoder, shape.stride_t);
    let (h, w) = model.config().latent_size();
    let (mut latents, mut layouts, mut frames, mut emphasis) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let all = stage.latents.min((config.data.frames - 1) / stride + 1);
    for index in 0..stage.clips {
        let draws = Draws::new(seed, "batch", &[u64::from(step), index as u64]);
        let from_rollout = draws.uniform(1) < ROLLED && !rolled.is_empty();
        let clip_index = if from_rollout {
            draws.below(0, rolled.len() as u64)
        } else {
            batch::training_clip(config, clips, &draws)?
        };
        let clip = clips.read(clip_index, 0, 1 + (all - 1) * stride)?;
        let encoded = if from_rollout { rolled[clip_index as usize].clone() } else { encode(model, &clip) };
        latents.extend_from_slice(&encoded.values()[..all * h * w * shape.z]);
        let on = draws.uniform(2) >= LAYOUT_DROPOUT;
        for (step, layout) in latent_steps(&clip.frames, stride).iter().zip(latent_steps(&clip.layouts, stride)) {
            frames.extend(pixels::to_values(step).into_values());
            emphasis.extend(emphasis::of_pixels(&layout, config.data.road_users));
            let layout = pixels::to_values(&layout).into_values();
            if on { layouts.extend(layout) } else { layouts.resize(layouts.len() + layout.len(), 0.0) }
        }
    }
    let steps = stage.clips * all;
    let images = [steps * stride, 8 * h, 8 * w, 3];
    Ok(DecoderBatch {
        clips: stage.clips,
        latents: Array::new(&[steps, h, w, shape.z], latents),
        layouts: Array::new(&images, layouts),
        frames: Array::new(&images, frames),
        emphasis: Array::new(&[steps * stride, 8 * h, 8 * w, 1], emphasis),
    })
}

fn encode(model: &VideoModel, clip: &Clip) -> Array {
    autoencoder::encode(model.autoencoder(), &unguided(model.config()), clip)
}

/// Returns the preset with the decoder's guidance switched as the named stage has it.
pub(crate) fn preset(config: &TrainConfig, stage: &str) -> Result<ModelConfig, TrainError> {
    let mut model = config.model()?;
    model.control.decoder &= stage == NAME;
    Ok(model)
}

//! The guided decoder learns to draw from what the student generates, guided by the layouts.
//!
//! Encoder and student stay as they are. Most clips of a batch are latents of the student's own rollouts over training
//! clips, the rest are encoded frames; the target is always the true frame. Layouts are dropped now and then.

use std::sync::Arc;

use ds_clips::Clip;
use ds_nn::Array;
use ds_nn::step::DecoderBatch;
use ds_space::{Digest, DigestWriter, Draws};
use ds_video::{Rollout, VideoModel, tokens};

use crate::autoencoder::unguided;
use crate::batch::mean_step;
use crate::checkpoint::{Member, Run};
use crate::condition::latent_steps;
use crate::config::{DecoderConfig, TrainConfig};
use crate::error::TrainError;
use crate::frames::Frames;
use crate::sets::stored_autoencoder;
use crate::ship::{assembled, student_weights};
use crate::{Progress, Report, autoencoder, emphasis, evaluate};

const NAME: &str = "decoder";
const LAYOUT_DROPOUT: f64 = 0.1;
/// Share of clips that are the student's rollouts.
const ROLLED: f64 = 0.7;

/// Trains the guided decoder to its configured number of steps.
///
/// # Errors
/// If autoencoder or student are not trained, a file cannot be used or the loss is not finite.
pub fn run(config: &TrainConfig, progress: &mut dyn Progress) -> Result<Report, TrainError> {
    let recipe = config.decoder.as_ref().ok_or_else(|| TrainError::no_stage(NAME))?;
    let model = config.model()?;
    let frames = Frames::open(config, &recipe.stage.sets)?;
    let seed = DigestWriter::new().text(NAME).u64(config.seed).finish();
    let member = Member::new("model", &model.ae().declare(), recipe.stage.optimiser(), &seed)
        .starting_from(&stored_autoencoder(config, "autoencoder")?)
        .starting_from(&config.initial("vae.")?);
    let mut run = Run::open(config, NAME, &recipe.stage, vec![member])?;
    let student = student_weights(config)?;
    if run.unfinished() {
        let drawn = Arc::new(assembled(config, &student, "autoencoder")?);
        let source = Source { config, recipe, frames, rolled: Vec::new(), model: drawn };
        let source = Source { rolled: source.roll(progress)?, ..source };
        let team = config.backend.team();
        while run.unfinished() {
            let (weights, at) = (run.weights(), run.step);
            let step = mean_step(&team, &recipe.stage, |clip| {
                Ok(config.backend.decoding(&model.ae(), weights, &source.batch(&seed, at, clip)?))
            })?;
            if !run.apply(step, progress)? {
                break;
            }
        }
    }
    let figures = evaluate::held_out(config, &student, NAME, progress)?;
    Ok(run.report(figures))
}

struct Source<'a> {
    config: &'a TrainConfig,
    recipe: &'a DecoderConfig,
    frames: Frames,
    /// Clips and the student's latents for them.
    rolled: Vec<(Clip, Array)>,
    model: Arc<VideoModel>,
}

impl Source<'_> {
    fn length(&self) -> usize {
        1 + (self.recipe.stage.latents - 1) * self.model.config().vae.stride_t
    }

    /// Rolls the student out over drawn clips; latents [latents, h, w, z] as the decoder takes them.
    fn roll(&self, progress: &mut dyn Progress) -> Result<Vec<(Clip, Array)>, TrainError> {
        let team = self.config.backend.team();
        let indices: Vec<u64> = (0..self.recipe.rollouts).collect();
        let mut rolled = Vec::new();
        for part in indices.chunks(32) {
            for made in team.run(part.len(), |at| self.rollout(part[at])) {
                rolled.push(made?);
            }
            progress.note(&format!("rolled out {} of {} clips", rolled.len(), self.recipe.rollouts));
        }
        Ok(rolled)
    }

    fn rollout(&self, index: u64) -> Result<(Clip, Array), TrainError> {
        let config = self.model.config();
        let (h, w) = config.latent_size();
        let draws = Draws::from_seed(self.config.seed, "decoder-rollouts");
        let clip = self.frames.first(&Draws::from_seed(draws.u64(index), "clip"), self.length())?;
        let key = Digest::of(&index.to_le_bytes());
        let (first, layout) = (&clip.frames[0], &clip.layouts[0]);
        let (mut rollout, entry) = Rollout::new(Arc::clone(&self.model), key, "front", &clip.prompt, first, layout)?;
        let mut entries = vec![entry];
        entries.extend(rollout.generate(&clip.layouts[1..])?.committed);
        let frame = h * w * config.vae.z;
        let frames = entries.iter().flat_map(|entry| entry.clean.values.chunks_exact(frame));
        let values: Vec<f32> = frames.flat_map(|tokens| tokens::from_tokens(tokens, h, w)).collect();
        let latents = Array::new(&[values.len() / frame, h, w, config.vae.z], values);
        Ok((clip, self.model.denormalised(latents)))
    }

    /// Makes the batch of one drawn clip.
    fn batch(&self, seed: &Digest, step: u32, clip: u64) -> Result<DecoderBatch, TrainError> {
        let config = self.model.config();
        let (shape, stride, (h, w)) = (unguided(config), config.vae.stride_t, config.latent_size());
        let draws = Draws::new(seed, "batch", &[u64::from(step), clip]);
        let (clip, latents) = if draws.uniform(2) < ROLLED && !self.rolled.is_empty() {
            self.rolled[draws.below(0, self.rolled.len() as u64) as usize].clone()
        } else {
            let clip = self.frames.first(&draws, self.length())?;
            let latents = autoencoder::encode(self.model.autoencoder(), &shape, &clip.frames);
            (clip, latents)
        };
        let on = draws.uniform(3) >= LAYOUT_DROPOUT;
        let (mut layouts, mut frames, mut weights) = (Vec::new(), Vec::new(), Vec::new());
        for (step, layout) in latent_steps(&clip.frames, stride).iter().zip(latent_steps(&clip.layouts, stride)) {
            frames.extend(tokens::stacked(step).into_values());
            weights.extend(emphasis::of_pixels(&layout, self.config.road_users));
            let layout = tokens::stacked(&layout).into_values();
            if on { layouts.extend(layout) } else { layouts.resize(layouts.len() + layout.len(), 0.0) }
        }
        let images = latents.shape()[0] * stride;
        Ok(DecoderBatch {
            clips: 1,
            latents,
            layouts: Array::new(&[images, 8 * h, 8 * w, 3], layouts),
            frames: Array::new(&[images, 8 * h, 8 * w, 3], frames),
            emphasis: Array::new(&[images, 8 * h, 8 * w, 1], weights),
        })
    }
}

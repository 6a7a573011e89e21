//! The causal student, trained directly on data with the cache policy of inference.
//!
//! Recipe: diffusion forcing at the sampler's own levels. A sequence holds o_0 clean, every later latent at the level
//! that inference caches (`state(j)`: the state entering step j), and some latents once more at another sampler step.
//! Each sees earlier cached-level latents within window and sink. The loss is on the clean latent. At this size and
//! budget this is cheaper than regressing on a teacher's trajectories, and it trains the few-step sampler itself.

use std::sync::Arc;

use ds_nn::Weights;
use ds_nn::step::{self, CausalPlan, Level};
use ds_space::{Digest, DigestWriter, Draws};
use ds_video::{CacheSource, ModelConfig, VideoModel, sampler};

use crate::checkpoint::Run;
use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::latents::{LatentClips, noise, stored_autoencoder};
use crate::{Progress, Report, decoder, evaluate};

const NAME: &str = "student";
/// Chunks of a sequence that are queried at another level than the cached one.
const QUERIED_CHUNKS: usize = 2;

/// Trains the student to its configured number of steps.
///
/// # Errors
/// If the autoencoder is not trained, a file cannot be used or the loss is not finite.
pub fn run(config: &TrainConfig, progress: &mut dyn Progress) -> Result<Report, TrainError> {
    let model = config.model()?;
    let shape = model.dit();
    let seed = DigestWriter::new().text(NAME).u64(config.seed).finish();
    let mut run = Run::open(&config.folder, NAME, &config.student, &shape.declare(), &seed)?;
    run.start_from(&config.initial("dit.")?);
    if run.unfinished() {
        let clips = LatentClips::encode(config, progress)?;
        while run.unfinished() {
            let batch = clips.batch(&config.student, &seed, run.step)?;
            let plan = plan(&model, config, &seed, run.step, batch.clean.shape());
            let step = step::causal(&shape, &run.weights, &batch, &plan);
            if !run.apply(&step, progress)? {
                break;
            }
        }
    }
    let figures = evaluate::held_out(config, &Arc::new(assembled(config, &run.average, "autoencoder")?), NAME)?;
    Ok(run.report(figures))
}

/// Puts the student and the autoencoder of a stage together.
pub(crate) fn assembled(config: &TrainConfig, student: &Weights, stage: &str) -> Result<VideoModel, TrainError> {
    let mut weights = Weights::default();
    weights.absorb("vae.", &stored_autoencoder(config, stage)?);
    weights.absorb("dit.", student);
    Ok(VideoModel::new(&decoder::preset(config, stage)?, &weights)?)
}

/// Draws levels, queried chunks and noise of a step.
fn plan(model: &ModelConfig, config: &TrainConfig, seed: &Digest, step: u32, clean: &[usize]) -> CausalPlan {
    let draws = Draws::new(seed, "plan", &[u64::from(step)]);
    let sigmas = sampler::sigmas(model.sampler.steps, model.sampler.shift);
    let (context, cached_step) = match model.cache_source() {
        CacheSource::State(at) => (sigmas[at - 1], Some(at - 1)),
        #[expect(clippy::cast_possible_truncation, reason = "levels are single precision")]
        CacheSource::Renoise(sigma) => (sigma as f32, None),
        CacheSource::Clean | CacheSource::X0Hat(_) => (0.0, None),
    };
    let others: Vec<f32> =
        sigmas.iter().enumerate().filter(|(index, _)| Some(*index) != cached_step).map(|(_, sigma)| *sigma).collect();
    let query = others.get(draws.below(0, others.len().max(1) as u64) as usize).copied().unwrap_or(context);
    let (chunk, frames) = (model.causal.chunk, clean[1]);
    let chunks = (frames - 1).div_ceil(chunk);
    let count = if cached_step.is_some() { QUERIED_CHUNKS.min(chunks) } else { chunks };
    let first = draws.below(1, (chunks - count + 1) as u64) as usize;
    let queries = 1 + first * chunk..(1 + (first + count) * chunk).min(frames);
    let noise_of = |purpose: &str, frames: usize| {
        noise(seed, purpose, step, &[config.student.clips, frames, clean[2], clean[3], clean[4]])
    };
    CausalPlan {
        cache: model.cache(),
        context: Level(context),
        context_trained: cached_step.is_some(),
        query: Level(query),
        prediction: model.prediction(),
        context_noise: noise_of("context-noise", frames - 1),
        query_noise: noise_of("query-noise", queries.len()),
        queries,
    }
}

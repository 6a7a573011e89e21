//! Stage 2: the causal student learns to go from the states of its few levels to where they end.
//!
//! Sequences hold o_0 clean, every later latent as inference would cache it, and latents at the sampler's other levels,
//! each seeing earlier context within window and sink (video-model.md 3.3). States and ends come from the teacher's
//! guided trajectories, or from clips with noise (diffusion forcing at the sampler's own levels).

use ds_nn::Array;
use ds_nn::step::{CausalPlan, ClipBatch, Level};
use ds_space::{Digest, DigestWriter, Draws};
use ds_video::sampling::cache_level;
use ds_video::{CacheSource, ModelConfig, sampler};

use crate::batch::Drawn;
use crate::checkpoint::{Member, Run};
use crate::condition::noise;
use crate::config::{OdeSource, TrainConfig};
use crate::error::TrainError;
use crate::sets::{Sets, Span};
use crate::teacher::later;
use crate::trajectories::Trajectories;
use crate::{Progress, Report, evaluate};

/// Trains the student to its configured number of steps.
///
/// # Errors
/// If the teacher or its trajectories are missing, a file cannot be used or the loss is not finite.
pub fn run(config: &TrainConfig, progress: &mut dyn Progress) -> Result<Report, TrainError> {
    let recipe = config.ode.as_ref().ok_or_else(|| TrainError::no_stage("ode"))?;
    let model = config.model()?;
    let shape = model.dit();
    let seed = DigestWriter::new().text("ode").u64(config.seed).finish();
    let mut member = Member::new("model", &shape.declare(), recipe.stage.optimiser(), &seed);
    member = if recipe.from_teacher {
        member.starting_from(&config.weights_of("teacher")?)
    } else {
        member.grown_from(&config.initial("dit.")?)
    };
    let mut run = Run::open(config, "ode", &recipe.stage, vec![member])?;
    if run.unfinished() {
        let source = Source::open(config, progress)?;
        let mut drawn = Drawn::new(config.backend, &recipe.stage);
        while run.unfinished() {
            let weights = run.weights();
            let draw = |at: u32, clip| source.clip(&model, &Draws::new(&seed, "batch", &[u64::from(at), clip]), &seed);
            let compute = |(batch, plan): &_| config.backend.causal(&shape, weights, batch, plan);
            let step = drawn.step(run.step, draw, compute)?;
            if !run.apply(step, progress)? {
                break;
            }
        }
    }
    let figures = evaluate::held_out(config, run.average(), "ode", progress)?;
    Ok(run.report(figures))
}

/// Where a causal step's states and targets come from.
pub(crate) struct Source {
    sets: Sets,
    trajectories: Option<Trajectories>,
    latents: usize,
}

impl Source {
    pub(crate) fn open(config: &TrainConfig, progress: &mut dyn Progress) -> Result<Self, TrainError> {
        let recipe = config.ode.as_ref().ok_or_else(|| TrainError::no_stage("ode"))?;
        let trajectories = match recipe.source {
            OdeSource::Trajectories => Some(Trajectories::open(config, &recipe.stage.sets)?),
            OdeSource::Data if matches!(config.model()?.cache_source(), CacheSource::X0Hat(_)) => {
                let rule = "source = \"data\" does not go with cache_source = \"x0hat(j)\": clips with noise have no \
                            estimate after a step; take trajectories, or another cache source";
                return Err(TrainError::Config { field: "ode", rule: rule.to_owned() });
            }
            OdeSource::Data => None,
        };
        let names = trajectories.as_ref().map_or(recipe.stage.sets.as_slice(), Trajectories::sets);
        Ok(Self { sets: Sets::open(config, names, progress)?, trajectories, latents: recipe.stage.latents })
    }

    /// Draws a clip and the causal step that is asked of it.
    pub(crate) fn clip(
        &self,
        model: &ModelConfig,
        draws: &Draws,
        seed: &Digest,
    ) -> Result<(ClipBatch, CausalPlan), TrainError> {
        let sigmas = sampler::sigmas(model.sampler.steps, model.sampler.shift);
        let key = [draws.u64(8)];
        let (batch, state) = match &self.trajectories {
            Some(trajectories) => {
                let drawn = trajectories.draw(&self.sets, draws)?;
                (drawn.batch, Some(drawn.states))
            }
            None => {
                let at = self.sets.draw(draws)?;
                let count = self.latents.min(self.sets.latents(at));
                (self.sets.batch(at, Span { from: 0, count })?, None)
            }
        };
        let target = frames_after_first(&batch);
        // The state at a sampler step, counted from 0.
        let at_step = |step: usize| match &state {
            Some(states) => states[step].clone(),
            None => {
                sampler::noised(&target, &noise(seed, "state", &[key[0], step as u64], target.shape()), sigmas[step])
            }
        };
        let source = model.cache_source();
        let cached_step = if let CacheSource::State(step) = source { Some(step - 1) } else { None };
        let level = cache_level(model);
        let context = match (source, cached_step) {
            (_, Some(step)) => at_step(step),
            (CacheSource::Renoise(_), _) => {
                sampler::noised(&target, &noise(seed, "context", &key, target.shape()), level)
            }
            (CacheSource::X0Hat(step), _) => {
                estimate([&at_step(step - 1), &at_step(step)], [sigmas[step - 1], sigmas[step]])
            }
            _ => target.clone(),
        };
        let others: Vec<usize> = (0..sigmas.len()).filter(|step| Some(*step) != cached_step).collect();
        let asked = others.get(draws.below(9, others.len().max(1) as u64) as usize).copied();
        let frames = batch.clean.shape()[1];
        let queries = if asked.is_some() { 1..frames } else { 1..1 };
        let query = asked.map_or_else(|| empty(&target), at_step);
        let plan = CausalPlan {
            cache: model.cache(),
            context,
            context_level: Level(level),
            context_trained: cached_step.is_some(),
            context_detached: false,
            queries,
            query,
            query_level: Level(asked.map_or(level, |step| sigmas[step])),
            target,
            prediction: model.prediction(),
        };
        Ok((batch, plan))
    }
}

/// Returns the clean latent that one step of the sampler must have seen to go from a state to the next one along a
/// trajectory: x' = x0 + σ'/σ·(x − x0) gives x0 = (x' − σ'/σ·x) / (1 − σ'/σ). That is the teacher's own estimate where it
/// went there in one step, and between its estimates where it went in several.
fn estimate([from, to]: [&Array; 2], [high, low]: [f32; 2]) -> Array {
    let share = low / high;
    let clean = from.values().iter().zip(to.values()).map(|(from, to)| (to - share * from) / (1.0 - share));
    Array::new(to.shape(), clean.collect())
}

/// Returns the clean latents of frames 1..F.
pub(crate) fn frames_after_first(batch: &ClipBatch) -> Array {
    let shape = later(batch);
    let frame: usize = shape[2..].iter().product();
    Array::new(&shape, batch.clean.values()[frame..].to_vec())
}

fn empty(like: &Array) -> Array {
    let mut shape = like.shape().to_vec();
    shape[1] = 0;
    Array::new(&shape, Vec::new())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_estimate_is_the_clean_latent_that_a_step_went_towards() {
        let (clean, noise) = (Array::new(&[2], vec![0.5, -2.0]), Array::new(&[2], vec![1.0, 3.0]));
        let [high, low] = [1.0, 0.8];
        let (from, to) = (sampler::noised(&clean, &noise, high), sampler::noised(&clean, &noise, low));
        let found = estimate([&from, &to], [high, low]);
        assert!(found.values().iter().zip(clean.values()).all(|(a, b)| (a - b).abs() < 1e-5), "{found:?}");
        // From 4 half the way towards 4, then half the way towards 0: the estimate lies between.
        let states = [4.0, 4.0, 2.0].map(|value| Array::new(&[1], vec![value]));
        let found = estimate([&states[0], &states[2]], [1.0, 0.25]);
        assert!((found.values()[0] - 4.0 / 3.0).abs() < 1e-6, "{found:?}");
    }
}

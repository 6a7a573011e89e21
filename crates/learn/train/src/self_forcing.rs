//! Stage 3: Self Forcing with distribution matching (video-model.md 3.4).
//!
//! The generator rolls itself out with the cache of inference; all chunks leave at one drawn exit step. A window of the
//! rollout is noised and shown to two bidirectional networks: the frozen teacher under guidance and a critic that
//! follows the generator's own distribution. The difference of their predictions moves the generator, through its
//! exit steps alone. Every iteration updates the critic on a rollout of its own, every n-th the generator before it.

use ds_nn::body::Transformer;
use ds_nn::dit::DitShape;
use ds_nn::step::{BidirectionalPlan, CausalPlan, ClipBatch, Level, Step};
use ds_nn::team::Team;
use ds_nn::{Array, Weights};
use ds_space::{Digest, DigestWriter, Draws};
use ds_video::sampling::cache_level;
use ds_video::{ModelConfig, sampler};

use crate::batch::mean_step;
use crate::checkpoint::{Member, Run, Update};
use crate::condition::noise;
use crate::config::{SelfForcingConfig, TrainConfig};
use crate::error::TrainError;
use crate::guidance::{Dropout, Guidance, Teacher};
use crate::ode::{Source, frames_after_first};
use crate::sets::{Sets, Span};
use crate::unroll::{Unrolled, unroll};
use crate::{Progress, Report, evaluate};

const GENERATOR: usize = 0;
const CRITIC: usize = 1;
/// Levels outside are not scored.
const SCORED_LEVELS: (f32, f32) = (0.02, 0.98);

/// Trains generator and critic to the configured number of iterations.
///
/// # Errors
/// If an earlier stage is missing, a file cannot be used or a loss is not finite.
pub fn run(config: &TrainConfig, progress: &mut dyn Progress) -> Result<Report, TrainError> {
    let recipe = config.self_forcing.as_ref().ok_or_else(|| TrainError::no_stage("self_forcing"))?;
    let model = config.model()?;
    let shape = model.dit();
    let seed = DigestWriter::new().text("self-forcing").u64(config.seed).finish();
    let (student, teacher) = (config.weights_of("ode")?, config.weights_of("teacher")?);
    let member = |name, start: &Weights| {
        Member::new(name, &shape.declare(), recipe.stage.optimiser(), &seed).starting_from(start)
    };
    let members = vec![member("generator", &student), member("critic", &teacher)];
    let mut run = Run::open(config, "self_forcing", &recipe.stage, members)?;
    if run.unfinished() {
        let regression = if recipe.regression > 0.0 { Some(Source::open(config, progress)?) } else { None };
        let sets = Sets::open(config, &recipe.stage.sets, progress)?;
        let (model, teacher) = (&model, Teacher::new_on(config.backend, &model, &teacher, config.unconditional)?);
        let trainer =
            Trainer { model, shape, recipe, sets, regression, teacher, seed, team: config.backend.team(), config };
        while run.unfinished() {
            let mut updates = Vec::new();
            let rate = recipe.stage.rate(run.step);
            let share = rate / recipe.stage.learning_rate;
            if run.step.is_multiple_of(recipe.generator_every) {
                let (step, regression) = trainer.generator(&run)?;
                let step = match regression {
                    Some(regression) => sum(step, regression.scaled(recipe.regression)),
                    None => step,
                };
                updates.push(Update { member: GENERATOR, step, rate });
            }
            let step = trainer.critic(&run)?;
            updates.push(Update { member: CRITIC, step, rate: share * recipe.critic_learning_rate });
            if !run.iterate(updates, progress)? {
                break;
            }
        }
    }
    let figures = evaluate::held_out(config, run.average(), "self_forcing", progress)?;
    Ok(run.report(figures))
}

struct Trainer<'a> {
    model: &'a ModelConfig,
    shape: DitShape,
    recipe: &'a SelfForcingConfig,
    sets: Sets,
    regression: Option<Source>,
    teacher: Teacher,
    seed: Digest,
    team: Team,
    config: &'a TrainConfig,
}

/// A rollout and the window of it that is scored.
struct Scene {
    guidance: Guidance,
    clip: ClipBatch,
    rolled: Unrolled,
    /// Frames of the window, within 1..F.
    window: std::ops::Range<usize>,
    exit: usize,
    draws: Draws,
    key: Digest,
}

impl Trainer<'_> {
    /// The exit step of all chunks of an iteration, from 1.
    fn exit(&self, step: u32) -> usize {
        1 + Draws::new(&self.seed, "exit", &[u64::from(step)]).below(0, self.model.sampler.steps as u64) as usize
    }

    fn scene(&self, dit: &dyn Transformer, purpose: &str, step: u32, clip: u64) -> Result<Scene, TrainError> {
        let draws = Draws::new(&self.seed, purpose, &[u64::from(step), clip]);
        let key = DigestWriter::new().digest(&self.seed).text(purpose).u32(step).u64(clip).finish();
        let at = self.sets.draw(&draws)?;
        let guidance = self.sets.guidance(self.config, self.recipe.guidance, at);
        let count = self.recipe.rollout.min(self.sets.latents(at));
        let clip = self.sets.batch(at, Span { from: 0, count })?;
        let exit = self.exit(step);
        let rolled = unroll(self.model, dit, &clip, &key, exit);
        let scored = (self.recipe.stage.latents - 1).min(count - 1);
        let chunk = self.model.causal.chunk;
        // Windows begin with a chunk.
        let places = (count - 1 - scored) / chunk + 1;
        let from = 1 + chunk * draws.below(5, places as u64) as usize;
        Ok(Scene { guidance, clip, rolled, window: from..from + scored, exit, draws, key })
    }

    /// Returns the window of a rollout as a clip of its own: what comes before it is its given frame.
    fn window(&self, scene: &Scene) -> ClipBatch {
        let [_, _, n, _, z]: [usize; 5] = scene.clip.clean.shape().try_into().expect("clean latents have five axes");
        let (frame, row) = (n * 4 * z, n * 4 * scene.clip.layouts.shape()[3]);
        let mut clean = scene.clip.clean.values()[..frame].to_vec();
        clean.extend_from_slice(scene.rolled.clean.values());
        let before = scene.window.start - 1;
        let frames = scene.window.len() + 1;
        let cut = |values: &[f32], per_frame: usize| values[before * per_frame..(before + frames) * per_frame].to_vec();
        ClipBatch {
            clean: Array::new(&[1, frames, n, 4, z], cut(&clean, frame)),
            layouts: Array::new(
                &[1, frames * n, 4, scene.clip.layouts.shape()[3]],
                cut(scene.clip.layouts.values(), row),
            ),
            emphasis: Array::new(&[1, frames, n, 4, 1], vec![1.0; frames * n * 4]),
            ..scene.clip.clone()
        }
    }

    fn level(&self, draws: &Draws) -> f32 {
        let nominal = draws.range(6, 0.0, 1.0);
        sampler::shifted(nominal, self.model.sampler.shift).clamp(SCORED_LEVELS.0, SCORED_LEVELS.1)
    }

    /// The distribution-matching step of the generator, and its regression on trajectories.
    fn generator(&self, run: &Run) -> Result<(Step, Option<Step>), TrainError> {
        let (weights, critic) = (&run.members[GENERATOR].weights, &run.members[CRITIC].weights);
        let critic = &Teacher::new_on(self.config.backend, self.model, critic, Dropout::Layout)?;
        let dit = self.config.backend.transformer(&self.shape, weights)?;
        let (stage, at) = (&self.recipe.stage, run.step);
        let step = mean_step(&self.team, stage, |clip| {
            let scene = self.scene(&*dit, "generator", at, clip)?;
            Ok(self.matched(&scene, weights, critic))
        })?;
        let Some(source) = &self.regression else { return Ok((step, None)) };
        let regression = mean_step(&self.team, stage, |clip| {
            let draws = Draws::new(&self.seed, "regression", &[u64::from(at), clip]);
            let (batch, plan) = source.clip(self.model, &draws, &self.seed)?;
            Ok(self.config.backend.causal(&self.shape, weights, &batch, &plan))
        })?;
        Ok((step, Some(regression)))
    }

    /// L_sf = ½‖x̂0 − sg(x̂0 − g)‖² with g the difference of the scores, normalised.
    fn matched(&self, scene: &Scene, weights: &Weights, critic: &Teacher) -> Step {
        let window = self.window(scene);
        let made = frames_after_first(&window);
        let sigma = self.level(&scene.draws);
        let noisy = sampler::noised(&made, &noise(&scene.key, "score", &[], made.shape()), sigma);
        let fake = critic.clean(&window, &noisy, sigma, Guidance::by(1.0));
        let real = self.teacher.clean(&window, &noisy, sigma, scene.guidance);
        let moved = direction(&made, &fake, &real);
        let frame = made.values().len() / scene.window.len();
        let mut target = scene.rolled.clean.clone();
        let part = (scene.window.start - 1) * frame..(scene.window.end - 1) * frame;
        let targets = &mut target.values_mut()[part.clone()];
        targets.iter_mut().zip(moved.values()).for_each(|(target, moved)| *target -= moved);
        let mut query_shape = scene.rolled.query.shape().to_vec();
        query_shape[1] = scene.window.len();
        // What comes after the window is seen by nothing in it.
        let frames = scene.window.end;
        let cut = |array: &Array| {
            let mut shape = array.shape().to_vec();
            shape[1] = frames - 1;
            Array::new(&shape, array.values()[..(frames - 1) * frame].to_vec())
        };
        let sigmas = sampler::sigmas(self.model.sampler.steps, self.model.sampler.shift);
        let plan = CausalPlan {
            cache: self.model.cache(),
            context: cut(&scene.rolled.context),
            context_level: Level(cache_level(self.model)),
            context_trained: false,
            context_detached: true,
            queries: scene.window.clone(),
            query: Array::new(&query_shape, scene.rolled.query.values()[part].to_vec()),
            query_level: Level(sigmas[scene.exit - 1]),
            target: cut(&target),
            prediction: self.model.prediction(),
        };
        let mut step =
            self.config.backend.causal(&self.shape, weights, &shortened(&scene.clip, frames), &plan).scaled(0.5);
        step.parts = vec![("matching", step.loss)];
        step
    }

    /// The flow-matching step of the critic on the generator's rollouts.
    fn critic(&self, run: &Run) -> Result<Step, TrainError> {
        let (weights, critic) = (&run.members[GENERATOR].weights, &run.members[CRITIC].weights);
        let dit = self.config.backend.transformer(&self.shape, weights)?;
        let at = run.step;
        mean_step(&self.team, &self.recipe.stage, |clip| {
            let scene = self.scene(&*dit, "critic", at, clip)?;
            let window = self.window(&scene);
            let plan = BidirectionalPlan {
                levels: vec![self.level(&scene.draws)],
                noise: noise(&scene.key, "score", &[], frames_after_first(&window).shape()),
                prediction: self.model.prediction(),
            };
            Ok(self.config.backend.bidirectional(&self.shape, critic, &window, &plan))
        })
    }
}

/// g = (x0_fake − x0_real) / mean|x̂0 − x0_real|; zero where that is not finite.
fn direction(made: &Array, fake: &Array, real: &Array) -> Array {
    let pairs = made.values().iter().zip(real.values());
    #[expect(clippy::cast_precision_loss, reason = "a mean over a window")]
    let size = pairs.map(|(made, real)| f64::from((made - real).abs())).sum::<f64>() / made.values().len() as f64;
    #[expect(clippy::cast_possible_truncation, reason = "directions are single precision")]
    let value = |(fake, real): (&f32, &f32)| {
        let moved = (f64::from(fake - real) / size) as f32;
        if moved.is_finite() { moved } else { 0.0 }
    };
    Array::new(made.shape(), fake.values().iter().zip(real.values()).map(value).collect())
}

/// Returns the first frames of a clip.
fn shortened(clip: &ClipBatch, frames: usize) -> ClipBatch {
    let [_, _, n, _, z]: [usize; 5] = clip.clean.shape().try_into().expect("clean latents have five axes");
    let inputs = clip.layouts.shape()[3];
    ClipBatch {
        clean: Array::new(&[1, frames, n, 4, z], clip.clean.values()[..frames * n * 4 * z].to_vec()),
        layouts: Array::new(&[1, frames * n, 4, inputs], clip.layouts.values()[..frames * n * 4 * inputs].to_vec()),
        // The direction counts alike everywhere.
        emphasis: Array::new(&[1, frames, n, 4, 1], vec![1.0; frames * n * 4]),
        ..clip.clone()
    }
}

fn sum(mut a: Step, b: Step) -> Step {
    a.add(&b);
    a.parts.push(("regression", b.loss));
    a
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_direction_points_from_real_to_fake_in_units_of_the_distance() {
        let array = |values: &[f32]| Array::new(&[1, values.len()], values.to_vec());
        let g = direction(&array(&[1.0, 1.0]), &array(&[2.0, 0.0]), &array(&[0.0, -1.0]));
        assert_eq!(g.values(), [2.0 / 1.5, 1.0 / 1.5]);
        assert_eq!(direction(&array(&[1.0]), &array(&[2.0]), &array(&[1.0])).values(), [0.0]);
    }
}

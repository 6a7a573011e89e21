//! The bidirectional stages: the prior (stage 0) and the teacher (stage 1).
//!
//! Both are flow matching over clips after a given first frame, one level per clip, uniform in the shifted schedule.
//! The prior sees all appearances, first frame and prompt, and never a layout; the teacher starts from it and learns
//! to follow layouts on ordinary daylight. What is dropped from the teacher's condition is what guidance then
//! amplifies ([`crate::guidance`]).

use ds_nn::fast;
use ds_nn::step::{BidirectionalPlan, ClipBatch};
use ds_nn::team::Team;
use ds_space::{Digest, DigestWriter, Draws};
use ds_video::{ModelConfig, sampler};

use crate::batch::mean_step;
use crate::checkpoint::{Member, Run};
use crate::config::{Dropout, StageConfig, TeacherConfig, TrainConfig};
use crate::error::TrainError;
use crate::guidance::Teacher;
use crate::sets::{Sets, Span, noise};
use crate::{Progress, Report};

const EVALUATION_STEPS: usize = 12;
const EVALUATION_CLIPS: u64 = 8;

/// Trains the prior to its configured number of steps.
///
/// # Errors
/// If the autoencoder is not trained, a file cannot be used or the loss is not finite.
pub fn prior(config: &TrainConfig, progress: &mut dyn Progress) -> Result<Report, TrainError> {
    let stage = config.prior.as_ref().ok_or_else(|| TrainError::no_stage("prior"))?;
    let model = config.model()?;
    let seed = DigestWriter::new().text("prior").u64(config.seed).finish();
    let member = Member::new("model", &model.dit().declare(), stage.optimiser(), &seed);
    let member = member.starting_from(&config.initial("dit.")?);
    let trainer = Trainer { config, model, stage, seed, layout_on: 0.0, dropout: (Dropout::None, 0.0) };
    trainer.run("prior", member, progress)
}

/// Trains the teacher to its configured number of steps, from the prior if there is one.
///
/// # Errors
/// As [`prior`].
pub fn teacher(config: &TrainConfig, progress: &mut dyn Progress) -> Result<Report, TrainError> {
    let TeacherConfig { stage, dropout, dropout_share } =
        config.teacher.as_ref().ok_or_else(|| TrainError::no_stage("teacher"))?;
    let model = config.model()?;
    let seed = DigestWriter::new().text("teacher").u64(config.seed).finish();
    let mut member = Member::new("model", &model.dit().declare(), stage.optimiser(), &seed);
    if config.finished("prior.safetensors").exists() {
        member = member.starting_from(&config.weights_of("prior")?);
    }
    let dropout = (*dropout, *dropout_share);
    let trainer = Trainer { config, model, stage, seed, layout_on: 1.0, dropout };
    trainer.run("teacher", member, progress)
}

struct Trainer<'a> {
    config: &'a TrainConfig,
    model: ModelConfig,
    stage: &'a StageConfig,
    seed: Digest,
    layout_on: f32,
    dropout: (Dropout, f64),
}

impl Trainer<'_> {
    fn run(&self, name: &'static str, member: Member, progress: &mut dyn Progress) -> Result<Report, TrainError> {
        let mut run = Run::open(&self.config.folder, name, self.stage, vec![member])?;
        let sets = Sets::open(self.config, &self.stage.sets, progress)?;
        let (shape, team) = (self.model.dit(), Team::of_all_cores());
        let shape = &shape;
        while run.unfinished() {
            let (weights, at) = (run.weights(), run.step);
            let step = mean_step(&team, self.stage.clips, |clip| {
                let (batch, plan) = self.clip(&sets, at, clip)?;
                Ok(fast::train::bidirectional(shape, weights, &batch, &plan))
            })?;
            if !run.apply(step, progress)? {
                break;
            }
        }
        let teacher = Teacher::new(&self.model, run.average(), self.dropout.0)?;
        let figures = evaluate(&sets, &teacher, self.stage.latents, &self.seed, self.layout_on)?;
        Ok(run.report(figures))
    }

    /// Draws a clip of a step, its level and its noise.
    fn clip(&self, sets: &Sets, step: u32, clip: u64) -> Result<(ClipBatch, BidirectionalPlan), TrainError> {
        let draws = Draws::new(&self.seed, "batch", &[u64::from(step), clip]);
        let at = sets.draw(&draws)?;
        let mut batch = sets.batch(at, sets.span(at, self.stage.latents, &draws))?;
        if draws.uniform(4) < self.config.without_first {
            batch.start.values_mut().fill(0.0);
            batch.clean.values_mut()[..sets.frame()].fill(0.0);
        }
        let dropped = draws.uniform(2) < self.dropout.1;
        batch.layout_on = vec![if dropped && self.dropout.0 != Dropout::None { 0.0 } else { self.layout_on }];
        batch.given_on = vec![if dropped && self.dropout.0 == Dropout::All { 0.0 } else { 1.0 }];
        let plan = BidirectionalPlan {
            levels: vec![sampler::shifted(draws.range(3, 0.001, 1.0), self.model.sampler.shift)],
            noise: noise(&self.seed, "noise", &[u64::from(step), clip], &later(&batch)),
            prediction: self.model.prediction(),
        };
        Ok((batch, plan))
    }
}

/// Returns the shape of frames 1..F of a batch.
pub(crate) fn later(batch: &ClipBatch) -> Vec<usize> {
    let mut shape = batch.clean.shape().to_vec();
    shape[1] -= 1;
    shape
}

/// Measures the mean square error of sampled against true latents, with and without the layout.
fn evaluate(
    sets: &Sets,
    teacher: &Teacher<'_>,
    latents: usize,
    seed: &Digest,
    layout_on: f32,
) -> Result<Vec<(String, f32)>, TrainError> {
    let mut figures = Vec::new();
    for (name, on) in [("mse_with_layout", 1.0), ("mse_without_layout", 0.0)] {
        if on > layout_on {
            continue;
        }
        let (mut sum, mut count) = (0.0, 0.0);
        for clip in 0..EVALUATION_CLIPS {
            let draws = Draws::new(seed, "evaluation", &[clip]);
            let at = sets.draw(&draws)?;
            let mut batch = sets.batch(at, Span { from: 0, count: latents.min(sets.latents(at)) })?;
            batch.layout_on = vec![on];
            let noise = noise(seed, "evaluation-noise", &[clip], &later(&batch));
            let sampled = teacher.sample(&batch, &noise, EVALUATION_STEPS, 1.0, &mut |_, _| ());
            let clean = &batch.clean.values()[sets.frame()..];
            sum += sampled.values().iter().zip(clean).map(|(a, b)| (a - b).powi(2)).sum::<f32>();
            count += clean.len() as f32;
        }
        figures.push((name.to_owned(), sum / count));
    }
    Ok(figures)
}

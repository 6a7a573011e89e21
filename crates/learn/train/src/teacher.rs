//! The bidirectional stages: the prior (stage 0) and the teacher (stage 1).
//!
//! Both are flow matching over clips after a given first frame, one level per clip, uniform in the shifted schedule.
//! The prior sees all appearances, first frame and prompt, and never a layout; the teacher starts from it and learns
//! to follow layouts on ordinary daylight. What is dropped from the teacher's condition is what guidance then
//! amplifies ([`crate::guidance`]).

use ds_nn::step::{BidirectionalPlan, ClipBatch};
use ds_space::{Digest, DigestWriter, Draws};
use ds_video::{ModelConfig, sampler};

use crate::batch::Drawn;
use crate::checkpoint::{Member, Run};
use crate::condition::noise;
use crate::config::{StageConfig, TeacherConfig, TrainConfig};
use crate::error::TrainError;
use crate::guidance::{Dropout, Guidance, Teacher};
use crate::sets::{Encoder, Sets, Span};
use crate::{Progress, Report, sheet};

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
    let member = member.grown_from(&config.initial("dit.")?);
    Trainer { config, model, stage, seed, teacher: None }.run("prior", member, progress)
}

/// Trains the teacher to its configured number of steps, from the prior if there is one.
///
/// # Errors
/// As [`prior`].
pub fn teacher(config: &TrainConfig, progress: &mut dyn Progress) -> Result<Report, TrainError> {
    let recipe = config.teacher.as_ref().ok_or_else(|| TrainError::no_stage("teacher"))?;
    let stage = &recipe.stage;
    let model = config.model()?;
    let seed = DigestWriter::new().text("teacher").u64(config.seed).finish();
    let mut member =
        Member::new("model", &model.dit().declare(), stage.optimiser(), &seed).with_trunk_rate(recipe.trunk_rate);
    if config.finished("prior.safetensors").exists() {
        member = member.starting_from(&config.weights_of("prior")?);
    }
    Trainer { config, model, stage, seed, teacher: Some(recipe) }.run("teacher", member, progress)
}

struct Trainer<'a> {
    config: &'a TrainConfig,
    model: ModelConfig,
    stage: &'a StageConfig,
    seed: Digest,
    /// None: the prior.
    teacher: Option<&'a TeacherConfig>,
}

/// The clip sets of a run.
struct Source {
    own: Sets,
    /// Those of clips without layout, if they are others.
    replay: Option<Sets>,
}

impl Trainer<'_> {
    fn run(&self, name: &'static str, member: Member, progress: &mut dyn Progress) -> Result<Report, TrainError> {
        let mut run = Run::open(self.config, name, self.stage, vec![member])?;
        let replay = self.teacher.map(|teacher| &teacher.replay).filter(|replay| !replay.is_empty());
        let sets = Source {
            own: Sets::open(self.config, &self.stage.sets, progress)?,
            replay: replay.map(|replay| Sets::open(self.config, replay, progress)).transpose()?,
        };
        let (shape, mut drawn) = (self.model.dit(), Drawn::new(self.config.backend, self.stage));
        while run.unfinished() {
            let weights = run.weights();
            let compute = |(batch, plan): &_| self.config.backend.bidirectional(&shape, weights, batch, plan);
            let step = drawn.step(run.step, |at, clip| self.clip(&sets, at, clip), compute)?;
            if !run.apply(step, progress)? {
                break;
            }
        }
        let teacher = Teacher::new_on(self.config.backend, &self.model, run.average(), self.config.unconditional)?;
        let figures = self.evaluate(name, &sets.own, &teacher)?;
        Ok(run.report(figures))
    }

    fn layout_on(&self) -> f32 {
        if self.teacher.is_some() { 1.0 } else { 0.0 }
    }

    /// Draws what a clip lacks: each kind of dropout has its share of the unit interval.
    fn dropped(&self, draw: f64) -> Option<Dropout> {
        let teacher = self.teacher?;
        (1u32..)
            .zip(&teacher.dropout)
            .find(|(end, _)| draw < f64::from(*end) * teacher.dropout_share)
            .map(|(_, kind)| *kind)
    }

    /// Draws a clip of a step, its level and its noise.
    fn clip(&self, sets: &Source, step: u32, clip: u64) -> Result<(ClipBatch, BidirectionalPlan), TrainError> {
        let draws = Draws::new(&self.seed, "batch", &[u64::from(step), clip]);
        let dropped = self.dropped(draws.uniform(2));
        let sets = sets.replay.as_ref().filter(|_| dropped.is_some()).unwrap_or(&sets.own);
        let at = sets.draw(&draws)?;
        let mut batch = sets.batch(at, sets.span(at, self.stage.latents, &draws))?;
        if draws.uniform(4) < self.config.without_first {
            batch.start.values_mut().fill(0.0);
            batch.clean.values_mut()[..sets.frame()].fill(0.0);
        }
        batch.layout_on = vec![if dropped.is_some() { 0.0 } else { self.layout_on() }];
        batch.given_on = vec![if dropped == Some(Dropout::All) { 0.0 } else { 1.0 }];
        let plan = BidirectionalPlan {
            levels: vec![sampler::shifted(draws.range(3, 0.001, 1.0), self.model.sampler.shift)],
            noise: noise(&self.seed, "noise", &[u64::from(step), clip], &later(&batch)),
            prediction: self.model.prediction(),
        };
        Ok((batch, plan))
    }

    /// Measures the mean square error of sampled against true latents, with and without the layout, and writes a sheet
    /// named after the stage: true frames, sampled frames and, where they are seen, layouts.
    fn evaluate(&self, name: &str, sets: &Sets, teacher: &Teacher) -> Result<Vec<(String, f32)>, TrainError> {
        let encoder = Encoder::load(self.config)?;
        let (mut figures, mut rows) = (Vec::new(), Vec::new());
        for (figure, on) in [("mse_with_layout", 1.0), ("mse_without_layout", 0.0)] {
            if on > self.layout_on() {
                continue;
            }
            let (mut sum, mut count) = (0.0, 0.0);
            for clip in 0..EVALUATION_CLIPS {
                let at = sets.draw(&Draws::new(&self.seed, "evaluation", &[clip]))?;
                let latents = self.stage.latents.min(sets.latents(at));
                let mut batch = sets.batch(at, Span { from: 0, count: latents })?;
                batch.layout_on = vec![on];
                let noise = noise(&self.seed, "evaluation-noise", &[clip], &later(&batch));
                let sampled = teacher.sample(&batch, &noise, EVALUATION_STEPS, Guidance::by(1.0), &mut |_, _| ());
                let (first, clean) = batch.clean.values().split_at(sets.frame());
                sum += sampled.values().iter().zip(clean).map(|(a, b)| (a - b).powi(2)).sum::<f32>();
                count += clean.len() as f32;
                if figures.is_empty() {
                    let truth = sets.pictures(at, latents)?;
                    let made = encoder.decode(&[first, sampled.values()].concat(), self.model.latent_size());
                    rows.extend([sheet::excerpt(&truth.frames), sheet::excerpt(&made)]);
                    rows.extend((on > 0.0).then(|| sheet::excerpt(&truth.layouts)));
                }
            }
            figures.push((figure.to_owned(), sum / count));
        }
        sheet::write(&self.config.folder.join(format!("{name}.png")), &rows)?;
        Ok(figures)
    }
}

/// Returns the shape of frames 1..F of a batch.
pub(crate) fn later(batch: &ClipBatch) -> Vec<usize> {
    let mut shape = batch.clean.shape().to_vec();
    shape[1] -= 1;
    shape
}

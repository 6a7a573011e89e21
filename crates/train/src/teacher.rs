//! The bidirectional teacher: flow matching over whole clips with dropped layouts, and its guided sampler.
//!
//! One level per clip, uniform in the shifted schedule; target v = ε − x0. Guidance is G(c∅) + w·(G(c) − G(c∅)), where
//! c∅ lacks the layout alone. At the size of `cpu_train` the student does not need it; larger recipes start here.

use ds_nn::Array;
use ds_nn::step::{self, ClipBatch};
use ds_space::{Digest, DigestWriter, Draws};
use ds_video::{ModelConfig, sampler};

use crate::checkpoint::Run;
use crate::config::TrainConfig;
use crate::error::TrainError;
use crate::latents::{LatentClips, noise};
use crate::{Progress, Report};

const NAME: &str = "teacher";
const EVALUATION_STEPS: usize = 12;

/// Trains the teacher to its configured number of steps.
///
/// # Errors
/// If the autoencoder is not trained, a file cannot be used or the loss is not finite.
pub fn run(config: &TrainConfig, progress: &mut dyn Progress) -> Result<Report, TrainError> {
    let model = config.model()?;
    let shape = model.dit();
    let seed = DigestWriter::new().text(NAME).u64(config.seed).finish();
    let mut run = Run::open(&config.folder, NAME, &config.teacher, &shape.declare(), &seed)?;
    let clips = LatentClips::encode(config, progress)?;
    while run.unfinished() {
        let batch = clips.batch(&config.teacher, &seed, run.step)?;
        let levels = levels(&model, &seed, run.step, config.teacher.clips);
        let noise = noise(&seed, "noise", run.step, batch.clean.shape());
        let step = step::bidirectional(&shape, &run.weights, &batch, &levels, &noise);
        if !run.apply(&step, progress)? {
            break;
        }
    }
    let figures = evaluate(config, &model, &clips, &run, &seed)?;
    Ok(run.report(figures))
}

/// Draws one level per clip: uniform over the nominal schedule, then shifted.
fn levels(model: &ModelConfig, seed: &Digest, step: u32, clips: usize) -> Vec<f32> {
    let draws = Draws::new(seed, "levels", &[u64::from(step)]);
    let shift = model.sampler.shift;
    let level = |index: u64| {
        let nominal = draws.range(index, 0.001, 1.0);
        #[expect(clippy::cast_possible_truncation, reason = "levels are single precision")]
        let sigma = (shift * nominal / (1.0 + (shift - 1.0) * nominal)) as f32;
        sigma
    };
    (0..clips as u64).map(level).collect()
}

/// Samples clips from noise by Euler steps of the guided flow; returns latents in the shape of the batch's.
#[must_use]
pub fn sample(
    model: &ModelConfig,
    weights: &ds_nn::Weights,
    batch: &ClipBatch,
    noise: &Array,
    guidance: (usize, f32),
) -> Array {
    let (steps, weight) = guidance;
    let shape = model.dit();
    let without = ClipBatch {
        clean: batch.clean.clone(),
        layouts: batch.layouts.clone(),
        layout_on: vec![0.0; batch.layout_on.len()],
        text: batch.text.clone(),
        emphasis: batch.emphasis.clone(),
    };
    let mut sigmas = sampler::sigmas(steps, model.sampler.shift);
    sigmas.push(0.0);
    let mut state = noise.clone();
    for pair in sigmas.windows(2) {
        let levels = vec![pair[0]; batch.layout_on.len()];
        let with = step::teacher_flow(&shape, weights, batch, &state, &levels);
        let base = if (weight - 1.0).abs() < f32::EPSILON {
            None
        } else {
            Some(step::teacher_flow(&shape, weights, &without, &state, &levels))
        };
        for (index, value) in state.values_mut().iter_mut().enumerate() {
            let flow = with.values()[index];
            let flow = base.as_ref().map_or(flow, |base| base.values()[index] + weight * (flow - base.values()[index]));
            *value += (pair[1] - pair[0]) * flow;
        }
    }
    state
}

/// Measures the mean square error of sampled against true latents, with and without the layout.
fn evaluate(
    config: &TrainConfig,
    model: &ModelConfig,
    clips: &LatentClips,
    run: &Run,
    seed: &Digest,
) -> Result<Vec<(String, f32)>, TrainError> {
    let mut batch = clips.batch(&config.teacher, seed, u32::MAX)?;
    let noise = noise(seed, "evaluation", 0, batch.clean.shape());
    let mut figures = Vec::new();
    for (name, on) in [("mse_with_layout", 1.0), ("mse_without_layout", 0.0)] {
        batch.layout_on.fill(on);
        let sampled = sample(model, &run.average, &batch, &noise, (EVALUATION_STEPS, 1.0));
        let pairs = sampled.values().iter().zip(batch.clean.values());
        let mse = pairs.map(|(a, b)| (a - b).powi(2)).sum::<f32>() / sampled.values().len() as f32;
        figures.push((name.to_owned(), mse));
    }
    Ok(figures)
}

//! The state of training: weights, their average and the optimiser's moments, one file each time it is saved.

use std::path::Path;

use ds_graph::planner::{HEIGHT_PX, WIDTH_PX};
use ds_nn::optimiser::{AdamW, AdamWSettings, Schedule, Shape, move_average};
use ds_nn::safetensors::WeightsFile;
use ds_nn::{Array, Weights};
use ds_policy::Learned;
use ds_policy::camera::eye::normalise_into;
use ds_space::{DigestWriter, Draws};

use super::PolicyTrainError;
use super::augment::augment_into;
use super::dataset::Samples;
use super::gradient::gradient;
use super::judge::Judge;
use super::rasters::Rasters;
use super::settings::PolicySettings;
use super::step_sample::StepSample;
use super::{anchors, selection, vocabulary};

/// Weights under training.
pub(super) struct Learner {
    student: Learned,
    judge: Judge,
    rasters: Rasters,
    /// So many samples are the expert's, the first ones.
    expert: usize,
    weights: Weights,
    average: Weights,
    optimiser: AdamW,
    schedule: Schedule,
}

impl Learner {
    /// Goes on from a checkpoint, or starts anew where there is none, with anchors or words of the expert's samples
    /// where the network has some and with the weights in the file `begun` where it goes on from another.
    pub(super) fn resume(
        student: Learned,
        settings: &PolicySettings,
        expert: &Samples,
        checkpoint: &Path,
        begun: &Path,
    ) -> Result<Self, PolicyTrainError> {
        let (rasters, expert_samples) = (Rasters::open()?, expert.len());
        let adam = AdamWSettings { weight_decay: settings.weight_decay, ..AdamWSettings::default() };
        let (peak, warm_up) = (settings.learning_rate, settings.warm_up);
        let schedule = Schedule { peak, warm_up, total: settings.steps(), shape: Shape::Cosine };
        if !checkpoint.exists() {
            let seed = DigestWriter::new().text(&format!("{} policy", student.name())).u64(settings.seed).finish();
            let mut weights = Weights::initialised(&student.declared(), &seed);
            anchors::give(student, &mut weights, expert, settings.seed);
            vocabulary::give(student, &mut weights, expert, settings.seed);
            selection::give(student, &mut weights, expert, settings.seed);
            begin(student, &mut weights, begun)?;
            let optimiser = AdamW::new(adam, &weights);
            let judge = Judge::default();
            return Ok(Self {
                student,
                judge,
                rasters,
                expert: expert_samples,
                average: weights.clone(),
                weights,
                optimiser,
                schedule,
            });
        }
        let file = WeightsFile::read(checkpoint)?;
        let path = || checkpoint.display().to_string();
        let steps = file.metadata.get("steps").and_then(|text| text.parse().ok());
        let steps =
            steps.ok_or_else(|| PolicyTrainError::Samples { path: path(), problem: "has no step count".into() })?;
        let part = |prefix: &str| {
            let weights = file.weights.part(prefix);
            weights.check(&student.declared()).map(|()| weights)
        };
        let optimiser = AdamW::resumed(adam, steps, part("first.")?, part("second.")?);
        let (weights, average) = (part("weights.")?, part("average.")?);
        Ok(Self {
            student,
            judge: Judge::default(),
            rasters,
            expert: expert_samples,
            weights,
            average,
            optimiser,
            schedule,
        })
    }

    /// Writes the whole state.
    pub(super) fn save(&self, checkpoint: &Path) -> Result<(), PolicyTrainError> {
        let mut all = Weights::default();
        let parts = [
            ("weights.", &self.weights),
            ("average.", &self.average),
            ("first.", &self.optimiser.first),
            ("second.", &self.optimiser.second),
        ];
        for (prefix, weights) in parts {
            all.absorb(prefix, weights);
        }
        let metadata = [("steps".to_owned(), self.optimiser.steps.to_string())].into();
        Ok(WeightsFile { weights: all, metadata }.write(checkpoint)?)
    }

    /// Returns the steps made so far.
    pub(super) fn steps(&self) -> u32 {
        self.optimiser.steps
    }

    /// Returns the average of the weights.
    pub(super) fn average(&self) -> &Weights {
        &self.average
    }

    /// Makes one step on a drawn batch and returns its loss.
    pub(super) fn step(&mut self, settings: &PolicySettings, samples: &Samples) -> Result<f64, PolicyTrainError> {
        let step = self.steps();
        let batch = settings.batch as usize;
        let mut pixels = Vec::with_capacity(batch * HEIGHT_PX * WIDTH_PX * 3);
        let mut shown = Vec::with_capacity(batch);
        for slot in 0..batch as u64 {
            let seed = DigestWriter::new().u64(settings.seed).finish();
            let draws = Draws::new(&seed, "policy batch", &[u64::from(step), slot]);
            #[expect(clippy::cast_possible_truncation, reason = "below the number of samples")]
            let index = draws.below(100, samples.len() as u64) as usize;
            let sample = &samples.0[index];
            // Where the policy drove, others answered to it: their states are not those of the log.
            let raster = index < self.expert && draws.uniform(104) < self.student.rasters();
            if raster {
                normalise_into(self.rasters.image(&sample.place)?.rgb(), &mut pixels);
            } else {
                augment_into(&sample.rgb, &draws, &mut pixels);
            }
            let speed_mps = (f64::from(sample.speed_mps) + 0.15 * draws.normal(101)).max(0.0);
            shown.push(StepSample { sample, speed_mps, motion: draws.uniform(102) < 0.5, raster, draws });
        }
        let images = Array::new(&[batch, HEIGHT_PX, WIDTH_PX, 3], pixels);
        let shown_as = (&images, reversal(step, settings.steps()));
        let (loss, gradient) = gradient(self.student, &self.weights, shown_as.0, shown_as.1, &shown, &mut self.judge)?;
        let norm = self.optimiser.update(&mut self.weights, &gradient, self.schedule.rate(step));
        if !loss.is_finite() || !norm.is_finite() {
            return Err(PolicyTrainError::Diverged { step, loss });
        }
        // The average follows fast at first, so that the first values do not linger.
        let decay = settings.average_decay.min((1.0 + step as f32) / (10.0 + step as f32));
        move_average(&mut self.average, &self.weights, decay);
        Ok(loss)
    }
}

/// Puts the weights in a file among those of a network that goes on from another.
fn begin(student: Learned, weights: &mut Weights, file: &Path) -> Result<(), PolicyTrainError> {
    let Some(before) = student.begins_with() else { return Ok(()) };
    if !file.exists() {
        let [student, before] = [student, before].map(Learned::name);
        return Err(PolicyTrainError::Begin { student, before, path: file.display().to_string() });
    }
    let begun = WeightsFile::read(file)?.weights;
    begun.check(&before.declared())?;
    weights.absorb("", &begun);
    Ok(())
}

/// Returns how strongly a context unlearns whether it is of a raster, 0 at first and nearly 1 at the end: 2/(1 + e^(−10p)) − 1
/// (Ganin and Lempitsky 2015).
fn reversal(step: u32, steps: u32) -> f32 {
    let share = step as f32 / steps.max(1) as f32;
    2.0 / (1.0 + (-10.0 * share).exp()) - 1.0
}

//! A training run: weights, their moving average and the optimiser, in one file that is replaced atomically.

use std::path::{Path, PathBuf};

use ds_nn::optimiser::{AdamW, AdamWSettings, Schedule, move_average};
use ds_nn::safetensors::WeightsFile;
use ds_nn::{Declared, Weights};
use ds_space::Digest;

use crate::error::PerceptionError;

/// Decay of the averaged weights.
const AVERAGE_DECAY: f32 = 0.995;
/// Updates between checkpoints.
const SAVE_EVERY: u32 = 50;

/// A run that can stop after any step and go on later.
pub(crate) struct Run {
    path: Option<PathBuf>,
    key: String,
    schedule: Schedule,
    pub(crate) weights: Weights,
    pub(crate) average: Weights,
    adam: AdamW,
    pub(crate) step: u32,
}

impl Run {
    /// Begins from draws, or goes on from a checkpoint of the same key.
    pub(crate) fn open(
        path: Option<PathBuf>,
        key: &Digest,
        schedule: Schedule,
        declared: &[Declared],
    ) -> Result<Self, PerceptionError> {
        let weights = Weights::initialised(declared, key);
        let adam = AdamW::new(AdamWSettings::default(), &weights);
        let average = weights.clone();
        let mut run = Self { path, key: key.to_string(), schedule, weights, average, adam, step: 0 };
        if let Some(path) = run.path.clone().filter(|path| path.exists()) {
            run.resume(&path, declared)?;
        }
        Ok(run)
    }

    fn resume(&mut self, path: &Path, declared: &[Declared]) -> Result<(), PerceptionError> {
        let file = WeightsFile::read(path).map_err(PerceptionError::file(path))?;
        let refuse = |reason| PerceptionError::Checkpoint { path: path.display().to_string(), reason };
        if file.metadata.get("key") != Some(&self.key) {
            return Err(refuse("belongs to another recipe; move it away to begin anew"));
        }
        let step = file.metadata.get("step").and_then(|text| text.parse().ok());
        self.step = step.ok_or_else(|| refuse("has no step"))?;
        let part = |prefix: &str| {
            let part = file.weights.part(prefix);
            part.check(declared).map(|()| part)
        };
        (self.weights, self.average) = (part("weights.")?, part("average.")?);
        self.adam = AdamW::resumed(AdamWSettings::default(), self.step, part("first.")?, part("second.")?);
        Ok(())
    }

    pub(crate) fn unfinished(&self) -> bool {
        self.step < self.schedule.total
    }

    /// Applies a gradient and saves now and then.
    pub(crate) fn update(&mut self, loss: f64, gradient: &Weights) -> Result<(), PerceptionError> {
        let norm = self.adam.update(&mut self.weights, gradient, self.schedule.rate(self.step));
        if !loss.is_finite() || !norm.is_finite() {
            return Err(PerceptionError::Diverged { step: self.step, loss });
        }
        let decay = AVERAGE_DECAY.min((1 + self.step) as f32 / (10 + self.step) as f32);
        move_average(&mut self.average, &self.weights, decay);
        self.step += 1;
        if self.step.is_multiple_of(SAVE_EVERY) || !self.unfinished() {
            self.save()?;
        }
        Ok(())
    }

    fn save(&self) -> Result<(), PerceptionError> {
        let Some(path) = &self.path else { return Ok(()) };
        let mut file = WeightsFile::default();
        let parts = [("weights.", &self.weights), ("average.", &self.average)];
        for (prefix, part) in parts.into_iter().chain([("first.", &self.adam.first), ("second.", &self.adam.second)]) {
            file.weights.absorb(prefix, part);
        }
        file.metadata.insert("key".to_owned(), self.key.clone());
        file.metadata.insert("step".to_owned(), self.step.to_string());
        file.write(path).map_err(PerceptionError::file(path))
    }
}

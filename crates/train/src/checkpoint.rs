//! The state of a training run: weights, their moving average and the optimiser, in one file replaced atomically.

use std::io::Write;
use std::path::{Path, PathBuf};

use ds_nn::optimiser::{AdamW, move_average};
use ds_nn::safetensors::WeightsFile;
use ds_nn::step::Step;
use ds_nn::{Declared, Weights};
use ds_space::Digest;

use crate::config::StageConfig;
use crate::error::TrainError;
use crate::{Progress, Report};

/// A run that can stop after any step.
#[derive(Debug)]
pub struct Run {
    folder: PathBuf,
    name: &'static str,
    stage: StageConfig,
    /// The weights being trained.
    pub weights: Weights,
    /// Their moving average: what is evaluated and shipped.
    pub average: Weights,
    adam: AdamW,
    /// Updates made, of earlier runs too.
    pub step: u32,
    recent: f32,
}

impl Run {
    /// Continues from the stage's checkpoint, or begins from draws.
    ///
    /// # Errors
    /// If a checkpoint exists and does not fit.
    pub fn open(
        folder: &Path,
        name: &'static str,
        stage: &StageConfig,
        declared: &[Declared],
        seed: &Digest,
    ) -> Result<Self, TrainError> {
        std::fs::create_dir_all(folder).map_err(TrainError::io("work folder", folder))?;
        let weights = Weights::initialised(declared, seed);
        let settings = StageConfig::optimiser();
        let mut run = Self {
            folder: folder.to_path_buf(),
            name,
            stage: stage.clone(),
            average: weights.clone(),
            adam: AdamW::new(settings, &weights),
            weights,
            step: 0,
            recent: f32::NAN,
        };
        if run.path().exists() {
            let file = WeightsFile::read(&run.path())?;
            for (prefix, target) in [("weights.", &mut run.weights), ("average.", &mut run.average)] {
                *target = file.weights.part(prefix);
                target.check(declared)?;
            }
            let (first, second) = (file.weights.part("first."), file.weights.part("second."));
            first.check(declared)?;
            second.check(declared)?;
            let step = file.metadata.get("step").and_then(|text| text.parse().ok());
            let reason = || "it has no step".to_owned();
            let path = run.path().display().to_string();
            run.step = step.ok_or_else(|| TrainError::Checkpoint { path, reason: reason() })?;
            run.adam = AdamW::resumed(settings, run.step, first, second);
        }
        Ok(run)
    }

    /// Starts from other weights where they have the stage's names and shapes, if nothing was trained yet.
    pub fn start_from(&mut self, weights: &Weights) {
        if self.step > 0 {
            return;
        }
        for (name, array) in self.weights.iter_mut() {
            if let Some(other) = weights.get(name).filter(|other| other.shape() == array.shape()) {
                *array = other.clone();
            }
        }
        self.average = self.weights.clone();
    }

    fn path(&self) -> PathBuf {
        self.folder.join(format!("{}.checkpoint.safetensors", self.name))
    }

    /// Returns where the stage's averaged weights are written.
    #[must_use]
    pub fn weights_path(folder: &Path, name: &str) -> PathBuf {
        folder.join(format!("{name}.safetensors"))
    }

    /// Applies one step, logs it and stores a checkpoint when due. Returns whether to go on.
    ///
    /// # Errors
    /// If the loss is not finite or a file cannot be written.
    pub fn apply(&mut self, step: &Step, progress: &mut dyn Progress) -> Result<bool, TrainError> {
        if !step.loss.is_finite() {
            return Err(TrainError::Diverged { step: self.step, loss: step.loss });
        }
        let rate = self.stage.schedule().rate(self.step);
        let norm = self.adam.update(&mut self.weights, &step.gradient, rate);
        // The average warms up, so that early steps do not linger in it.
        let decay = self.stage.average.min((1 + self.step) as f32 / (10 + self.step) as f32);
        move_average(&mut self.average, &self.weights, decay);
        self.step += 1;
        self.recent = if self.recent.is_nan() { step.loss } else { 0.98 * self.recent + 0.02 * step.loss };
        progress.step(self.step, self.stage.steps, step.loss, &step.parts);
        self.log(step, rate, norm)?;
        let last = self.step >= self.stage.steps;
        let stop = progress.stop();
        if last || stop || self.step.is_multiple_of(self.stage.checkpoint_every) {
            self.save()?;
        }
        Ok(!last && !stop)
    }

    fn log(&self, step: &Step, rate: f32, norm: f32) -> Result<(), TrainError> {
        let path = self.folder.join(format!("{}.jsonl", self.name));
        let io = || TrainError::io("loss log", &path);
        let mut line = serde_json::json!({
            "step": self.step, "loss": step.loss, "recent": self.recent, "rate": rate, "norm": norm,
        });
        for (name, value) in &step.parts {
            line[*name] = serde_json::json!(value);
        }
        let mut file = std::fs::OpenOptions::new().create(true).append(true).open(&path).map_err(io())?;
        writeln!(file, "{line}").map_err(io())
    }

    fn save(&self) -> Result<(), TrainError> {
        let mut file = WeightsFile::default();
        file.weights.absorb("weights.", &self.weights);
        file.weights.absorb("average.", &self.average);
        file.weights.absorb("first.", &self.adam.first);
        file.weights.absorb("second.", &self.adam.second);
        file.metadata.insert("step".to_owned(), self.step.to_string());
        file.write(&self.path())?;
        let average = WeightsFile { weights: self.average.clone(), metadata: file.metadata };
        Ok(average.write(&Self::weights_path(&self.folder, self.name))?)
    }

    /// Ends the run.
    #[must_use]
    pub fn report(&self, figures: Vec<(String, f32)>) -> Report {
        let weights = Self::weights_path(&self.folder, self.name);
        Report { steps: self.step, loss: self.recent, figures, weights }
    }

    /// Says whether steps are left.
    #[must_use]
    pub fn unfinished(&self) -> bool {
        self.step < self.stage.steps
    }
}

//! The state of a training run: weights, their moving averages and the optimisers, in one file replaced atomically.
//!
//! A stage trains one network or, in Self Forcing, two; each is a *member* with an optimiser of its own. All draws are
//! keyed by the step, so that a run killed at any moment goes on from its last checkpoint to the same bits.

use std::io::Write;
use std::path::{Path, PathBuf};

use ds_nn::optimiser::{AdamW, AdamWSettings, move_average};
use ds_nn::safetensors::WeightsFile;
use ds_nn::step::Step;
use ds_nn::{Declared, Weights};
use ds_space::Digest;

use crate::config::{StageConfig, TrainConfig};
use crate::error::TrainError;
use crate::lineage::Lineage;
use crate::{Progress, Report, nested};

/// Where a checkpoint tells its recipe; one that does not is taken as it is.
const RECIPE: &str = "recipe";

/// One network of a run.
#[derive(Debug)]
pub struct Member {
    name: &'static str,
    /// The weights being trained.
    pub weights: Weights,
    /// Their moving average: what is evaluated and shipped.
    pub average: Weights,
    adam: AdamW,
    trunk_rate: f32,
}

/// Layers that read the layout; all others make up the trunk.
const LAYOUT_LAYERS: [&str; 2] = ["control_embedding.", "patch_embedding."];

impl Member {
    /// Makes a network of first values drawn from the seed.
    #[must_use]
    pub fn new(name: &'static str, declared: &[Declared], settings: AdamWSettings, seed: &Digest) -> Self {
        let weights = Weights::initialised(declared, seed);
        Self { name, average: weights.clone(), adam: AdamW::new(settings, &weights), weights, trunk_rate: 1.0 }
    }

    /// Lets the layers that do not read the layout learn at a share of the learning rate.
    #[must_use]
    pub fn with_trunk_rate(self, trunk_rate: f32) -> Self {
        Self { trunk_rate, ..self }
    }

    /// Takes other weights over where names and shapes agree.
    #[must_use]
    pub fn starting_from(mut self, weights: &Weights) -> Self {
        for (name, array) in self.weights.iter_mut() {
            if let Some(other) = weights.get(name).filter(|other| other.shape() == array.shape()) {
                *array = other.clone();
            }
        }
        self.average = self.weights.clone();
        self
    }

    /// Takes the weights of the same or of a smaller configuration over (`nested`).
    #[must_use]
    pub fn grown_from(mut self, weights: &Weights) -> Self {
        nested::copy(&mut self.weights, weights);
        self.average = self.weights.clone();
        self
    }

    fn parts(&self) -> [(&'static str, &Weights); 4] {
        let adam = &self.adam;
        [("weights", &self.weights), ("average", &self.average), ("first", &adam.first), ("second", &adam.second)]
    }

    fn resume(&mut self, file: &WeightsFile, path: &Path) -> Result<(), TrainError> {
        let settings = self.adam.settings();
        let part = |part: &str| -> Result<Weights, TrainError> {
            let found = file.weights.part(&format!("{}.{part}.", self.name));
            let differs = || {
                let reason = format!("network {:?} has other weights than the preset", self.name);
                TrainError::Checkpoint { path: path.display().to_string(), reason }
            };
            let same = found
                .iter()
                .map(|(name, array)| (name, array.shape()))
                .eq(self.weights.iter().map(|(name, array)| (name, array.shape())));
            if same { Ok(found) } else { Err(differs()) }
        };
        let (weights, average, first, second) = (part("weights")?, part("average")?, part("first")?, part("second")?);
        let updates = counter(file, &format!("{}.updates", self.name), path)?;
        self.adam = AdamW::resumed(settings, updates, first, second);
        (self.weights, self.average) = (weights, average);
        Ok(())
    }
}

/// What one iteration does to a member.
#[derive(Debug)]
pub struct Update {
    /// Its index.
    pub member: usize,
    /// Loss and gradient.
    pub step: Step,
    /// The learning rate.
    pub rate: f32,
}

/// A run that can stop after any step.
#[derive(Debug)]
pub struct Run {
    folder: PathBuf,
    name: &'static str,
    stage: StageConfig,
    lineage: Lineage,
    /// The networks.
    pub members: Vec<Member>,
    /// Steps made, of earlier runs too.
    pub step: u32,
    recent: f32,
}

impl Run {
    /// Continues from the stage's checkpoint, or begins with the members as they are.
    ///
    /// # Errors
    /// If a checkpoint exists and does not fit, or was made by a recipe that differs in what the stage depends on.
    pub fn open(
        config: &TrainConfig,
        name: &'static str,
        stage: &StageConfig,
        members: Vec<Member>,
    ) -> Result<Self, TrainError> {
        let folder = config.folder.clone();
        std::fs::create_dir_all(&folder).map_err(TrainError::io("work folder", &folder))?;
        let lineage = Lineage::of(config, name)?;
        let mut run = Self { folder, name, stage: stage.clone(), lineage, members, step: 0, recent: f32::NAN };
        let path = run.path();
        if path.exists() {
            let file = WeightsFile::read(&path)?;
            run.step = counter(&file, "step", &path)?;
            if let Some(made_by) = file.metadata.get(RECIPE) {
                run.lineage.check(made_by, stage, run.step, &path.display().to_string())?;
            }
            for member in &mut run.members {
                member.resume(&file, &path)?;
            }
        }
        Ok(run)
    }

    fn path(&self) -> PathBuf {
        self.folder.join(format!("{}.checkpoint.safetensors", self.name))
    }

    /// Returns the weights of the first member.
    #[must_use]
    pub fn weights(&self) -> &Weights {
        &self.members[0].weights
    }

    /// Returns the averaged weights of the first member.
    #[must_use]
    pub fn average(&self) -> &Weights {
        &self.members[0].average
    }

    /// Applies one step to the only member. Returns whether to go on.
    ///
    /// # Errors
    /// As [`Self::iterate`].
    pub fn apply(&mut self, step: Step, progress: &mut dyn Progress) -> Result<bool, TrainError> {
        let rate = self.stage.rate(self.step);
        self.iterate(vec![Update { member: 0, step, rate }], progress)
    }

    /// Applies the updates of one iteration, logs them and stores a checkpoint when due. Returns whether to go on.
    ///
    /// # Errors
    /// If a loss is not finite or a file cannot be written.
    pub fn iterate(&mut self, updates: Vec<Update>, progress: &mut dyn Progress) -> Result<bool, TrainError> {
        let mut line = serde_json::json!({ "step": self.step + 1 });
        let (mut loss, mut parts) = (f32::NAN, Vec::new());
        for Update { member, step, rate } in updates {
            if !step.loss.is_finite() {
                return Err(TrainError::Diverged { step: self.step, loss: step.loss });
            }
            let member = &mut self.members[member];
            let trunk = rate * member.trunk_rate;
            let of = |name: &str| if LAYOUT_LAYERS.iter().any(|layer| name.starts_with(layer)) { rate } else { trunk };
            let norm = member.adam.update_each(&mut member.weights, &step.gradient, &of);
            // The average warms up, so that early steps do not linger in it.
            let made = member.adam.steps;
            let decay = self.stage.average.min(made as f32 / (9 + made) as f32);
            move_average(&mut member.average, &member.weights, decay);
            let mut figures = serde_json::json!({ "loss": step.loss, "rate": rate, "norm": norm });
            for (name, value) in &step.parts {
                figures[*name] = serde_json::json!(value);
            }
            line[member.name] = figures;
            if loss.is_nan() {
                loss = step.loss;
            }
            parts.extend(step.parts);
        }
        self.step += 1;
        self.recent = if self.recent.is_nan() { loss } else { 0.98 * self.recent + 0.02 * loss };
        progress.step(self.step, self.stage.steps, loss, &parts);
        self.log(&line)?;
        let last = self.step >= self.stage.steps;
        let stop = progress.stop();
        if last || stop || self.step.is_multiple_of(self.stage.checkpoint_every) {
            self.save()?;
        }
        Ok(!last && !stop)
    }

    fn log(&self, line: &serde_json::Value) -> Result<(), TrainError> {
        let path = self.folder.join(format!("{}.jsonl", self.name));
        let io = || TrainError::io("loss log", &path);
        let mut file = std::fs::OpenOptions::new().create(true).append(true).open(&path).map_err(io())?;
        writeln!(file, "{line}").map_err(io())
    }

    fn save(&self) -> Result<(), TrainError> {
        let mut file = WeightsFile::default();
        for member in &self.members {
            for (part, weights) in member.parts() {
                file.weights.absorb(&format!("{}.{part}.", member.name), weights);
            }
            file.metadata.insert(format!("{}.updates", member.name), member.adam.steps.to_string());
        }
        file.metadata.insert("step".to_owned(), self.step.to_string());
        file.metadata.insert(RECIPE.to_owned(), self.lineage.text());
        let metadata = std::iter::once(("step".to_owned(), self.step.to_string())).collect();
        let average = WeightsFile { weights: self.average().clone(), metadata };
        // The checkpoint comes last: a run that is killed between the two makes its last steps again.
        average.write(&self.folder.join(format!("{}.safetensors", self.name)))?;
        Ok(file.write(&self.path())?)
    }

    /// Ends the run.
    #[must_use]
    pub fn report(&self, figures: Vec<(String, f32)>) -> Report {
        let weights = self.folder.join(format!("{}.safetensors", self.name));
        Report { steps: self.step, loss: self.recent, figures, weights }
    }

    /// Says whether steps are left.
    #[must_use]
    pub fn unfinished(&self) -> bool {
        self.step < self.stage.steps
    }
}

fn counter(file: &WeightsFile, key: &str, path: &Path) -> Result<u32, TrainError> {
    let reason = || format!("it has no {key:?}");
    let missing = || TrainError::Checkpoint { path: path.display().to_string(), reason: reason() };
    file.metadata.get(key).and_then(|text| text.parse().ok()).ok_or_else(missing)
}

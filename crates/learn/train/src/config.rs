//! The training configuration: one TOML file, naming the model preset, the work folder and the clip sets.
//!
//! Stages hand over files in the work folder: `autoencoder`, `prior`, `teacher`, `trajectories`, `ode`,
//! `self_forcing`, `decoder`. What a folder lacks is taken from `parent`, another recipe's work folder. A recipe may
//! say `inherits = FILE` (relative to it) and name only what differs; tables are merged key by key.

mod decoder;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ds_nn::optimiser::{AdamWSettings, Schedule, Shape};
use ds_nn::safetensors::WeightsFile;
use ds_nn::tiny_ae::BLOCK_PX;
use ds_nn::{Array, Weights};
use ds_video::{Backend, ModelConfig};
use serde::{Deserialize, Serialize};

use crate::error::TrainError;
use crate::guidance::{Dropout, Guidance};
pub use decoder::{AdversarialConfig, DecoderConfig};

/// A training recipe.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// Schema version, 2.
    pub version: u32,
    /// The model preset, relative to the configuration file.
    pub model: PathBuf,
    /// Work folder for checkpoints, logs and pages, relative to the current folder.
    pub folder: PathBuf,
    /// A work folder with the finished stages that this recipe does not train itself.
    #[serde(default)]
    pub parent: Option<PathBuf>,
    /// Keys all draws.
    pub seed: u64,
    /// Weights of a whole model of this preset or of a smaller one, within which the stages begin; relative to this file.
    #[serde(default)]
    pub initial: Option<PathBuf>,
    /// A file that `ship` wrote, whose decoder is averaged with the trained one when that is shipped; relative to this file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub averaged_with: Option<PathBuf>,
    /// What the cache keeps, in place of the preset's `causal.cache_source`.
    #[serde(default)]
    pub cache_source: Option<String>,
    /// What computes; the results of one back end equal another's up to rounding.
    #[serde(default)]
    pub backend: Backend,
    /// Clip sets by name: folders that `data render` made, relative to the current folder.
    pub sets: BTreeMap<String, PathBuf>,
    /// The set that students are looked at on; none are without it.
    #[serde(default)]
    pub held_out: Option<String>,
    /// How much more than others a pixel counts whose layout shows a vehicle, a pedestrian or a cyclist.
    #[serde(default = "alike")]
    pub road_users: f32,
    /// How much more a pixel counts whose layout shows a red, yellow or green light, or its stop line.
    #[serde(default = "alike")]
    pub lights: f32,
    /// The share of clips of prior and teacher that show no first frame, so that one can be made from layout and prompt.
    #[serde(default)]
    pub without_first: f64,
    /// What guidance does without (c∅), one of the teacher's `dropout`.
    #[serde(default)]
    pub unconditional: Dropout,
    /// Whether guidance of clips with an edited first frame leaves mean and deviation of each latent channel as c∅ has
    /// them; c∅ must keep the first frame.
    #[serde(default)]
    pub keep_look: bool,
    /// The lowest and the highest level σ at which guidance acts; all without it.
    #[serde(default = "everywhere")]
    pub guide_levels: [f32; 2],
    /// The autoencoder.
    #[serde(default)]
    pub autoencoder: Option<StageConfig>,
    /// Stage 0: all appearances, no layout.
    #[serde(default)]
    pub prior: Option<StageConfig>,
    /// Stage 1: the bidirectional teacher with layouts.
    #[serde(default)]
    pub teacher: Option<TeacherConfig>,
    /// The teacher's trajectories for stage 2.
    #[serde(default)]
    pub trajectories: Option<TrajectoryConfig>,
    /// Stage 2: the causal student from trajectories, or from data.
    #[serde(default)]
    pub ode: Option<OdeConfig>,
    /// Stage 3: Self Forcing.
    #[serde(default)]
    pub self_forcing: Option<SelfForcingConfig>,
    /// The guided decoder.
    #[serde(default)]
    pub decoder: Option<DecoderConfig>,
    /// Where this file lies; model paths start there.
    #[serde(skip)]
    pub base: PathBuf,
}

fn alike() -> f32 {
    1.0
}

/// What all stages that update weights have.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StageConfig {
    /// Names of the clip sets to draw from, each clip alike.
    pub sets: Vec<String>,
    /// Updates.
    pub steps: u32,
    /// Clips of a micro-batch, which are computed side by side.
    pub clips: usize,
    /// Micro-batches whose gradients are summed before an update.
    #[serde(default = "once")]
    pub accumulate: usize,
    /// Latent frames of a clip.
    pub latents: usize,
    /// Width and height of the part of a clip that is drawn, multiples of 8; all without it. Of the autoencoder alone.
    #[serde(default)]
    pub crop_px: Option<[u32; 2]>,
    /// Highest learning rate.
    pub learning_rate: f32,
    /// Updates until the highest rate.
    pub warm_up: u32,
    /// How the learning rate goes on after that.
    #[serde(default)]
    pub schedule: Shape,
    /// Decay of the averaged weights.
    pub average: f32,
    /// Updates between checkpoints.
    pub checkpoint_every: u32,
    /// Decay of the optimiser's first moment.
    #[serde(default = "beta1")]
    pub beta1: f32,
    /// Decay of the optimiser's second moment.
    #[serde(default = "beta2")]
    pub beta2: f32,
    /// The largest norm of a gradient.
    #[serde(default = "alike")]
    pub clip_norm: f32,
}

fn everywhere() -> [f32; 2] {
    Guidance::EVERYWHERE
}

fn once() -> usize {
    1
}

fn beta1() -> f32 {
    0.9
}

fn beta2() -> f32 {
    0.95
}

/// The teacher's recipe.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TeacherConfig {
    /// What all stages have.
    pub stage: StageConfig,
    /// What is dropped; nothing leaves no guidance.
    pub dropout: Vec<Dropout>,
    /// The share of clips in which each of them is dropped.
    #[serde(default = "tenth")]
    pub dropout_share: f64,
    /// Names of the clip sets that clips without layout are drawn from, so that the teacher does not forget the looks
    /// which never come with layouts; the stage's own without any.
    #[serde(default)]
    pub replay: Vec<String>,
    /// The share of the learning rate that layers have which do not read the layout.
    #[serde(default = "alike")]
    pub trunk_rate: f32,
}

fn tenth() -> f64 {
    0.1
}

/// How the teacher's trajectories are made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrajectoryConfig {
    /// Names of the clip sets whose first frames, prompts and layouts are the conditions, in turn.
    pub sets: Vec<String>,
    /// Trajectories of each set.
    pub count: u64,
    /// Latent frames of a trajectory.
    pub latents: usize,
    /// Euler steps, a multiple of the sampler's.
    pub steps: usize,
    /// Guidance w in G(c∅) + w·(G(c) − G(c∅)).
    pub guidance: f32,
    /// The share of each set's trajectories that is put aside, those whose look moved most from the first frame.
    #[serde(default)]
    pub reject: f64,
}

/// Where stage 2 finds its states and targets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OdeSource {
    /// The teacher's trajectories.
    Trajectories,
    /// Clips with noise (diffusion forcing).
    Data,
}

/// The recipe of stage 2.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OdeConfig {
    /// What all stages have; the sets are those of `data`, or whose trajectories count (all without any).
    pub stage: StageConfig,
    /// Where states and targets come from.
    pub source: OdeSource,
    /// Whether the student starts at the teacher's weights.
    #[serde(default = "yes")]
    pub from_teacher: bool,
}

fn yes() -> bool {
    true
}

/// The recipe of stage 3.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SelfForcingConfig {
    /// What all stages have; `latents` is the length of the clip that the scores see, the rates are the generator's.
    pub stage: StageConfig,
    /// Latent frames of a rollout, the given first one included.
    pub rollout: usize,
    /// Learning rate of the critic.
    pub critic_learning_rate: f32,
    /// Iterations per update of the generator; the critic is updated in each.
    pub generator_every: u32,
    /// Guidance of the frozen teacher.
    pub guidance: f32,
    /// Weight of the regression on trajectories that keeps the generator from collapse; 0 leaves it out.
    #[serde(default)]
    pub regression: f32,
}

impl StageConfig {
    /// Returns the learning rate of update `step`, counted from 0.
    pub(crate) fn rate(&self, step: u32) -> f32 {
        let shape = self.schedule;
        Schedule { peak: self.learning_rate, warm_up: self.warm_up, total: self.steps, shape }.rate(step)
    }

    /// Returns the clips of an update.
    pub(crate) fn batch(&self) -> usize {
        self.accumulate * self.clips
    }

    pub(crate) fn optimiser(&self) -> AdamWSettings {
        let clip_norm = self.clip_norm;
        AdamWSettings { beta1: self.beta1, beta2: self.beta2, clip_norm, ..AdamWSettings::default() }
    }

    fn check(&self, name: &'static str, sets: &BTreeMap<String, PathBuf>) -> Result<(), TrainError> {
        let refuse = |rule: String| Err(TrainError::Config { field: name, rule });
        let share = |value: f32| (0.0..1.0).contains(&value);
        let rate = self.learning_rate > 0.0 && self.learning_rate < 1.0;
        if let Some(set) = self.sets.iter().find(|set| !sets.contains_key(*set)) {
            return refuse(format!("clip set {set:?} is not among [sets]"));
        }
        if self.clips == 0 || self.clips > 256 || self.latents < 2 || self.latents > 256 {
            return refuse("clips must be 1 to 256 and latents 2 to 256".to_owned());
        }
        if let Some(crop) = self.crop_px {
            if name != "autoencoder" {
                return refuse(
                    "crop_px belongs to the autoencoder and, outside of its stage, to the decoder".to_owned(),
                );
            }
            if crop.iter().any(|side| *side == 0 || !side.is_multiple_of(BLOCK_PX as u32)) {
                return refuse(format!("crop_px {crop:?} must be multiples of 8 pixels"));
            }
        }
        if self.accumulate == 0 || self.accumulate > 4096 {
            return refuse("accumulate must be 1 to 4096".to_owned());
        }
        if !rate || !share(self.average) || !share(self.beta1) || !share(self.beta2) || self.clip_norm.is_nan() {
            return refuse("learning_rate, average, beta1 and beta2 must lie within (0, 1)".to_owned());
        }
        if self.checkpoint_every == 0 || self.clip_norm <= 0.0 {
            return refuse("checkpoint_every must be at least 1 and clip_norm positive".to_owned());
        }
        Ok(())
    }
}

/// The longest chain of recipes that inherit.
const GENERATIONS: u32 = 4;

/// Reads a recipe with what it inherits.
fn inherited(path: &Path, generation: u32) -> Result<toml::Table, TrainError> {
    let text = std::fs::read_to_string(path).map_err(TrainError::io("training configuration", path))?;
    let mut table: toml::Table = toml::from_str(&text)?;
    let Some(from) = table.remove("inherits") else { return Ok(table) };
    let refuse = |rule: String| TrainError::Config { field: "inherits", rule };
    let from = from.as_str().ok_or_else(|| refuse("must be a file".to_owned()))?;
    if generation == GENERATIONS {
        return Err(refuse(format!("more than {GENERATIONS} recipes inherit from each other")));
    }
    let mut base = inherited(&path.parent().unwrap_or(Path::new(".")).join(from), generation + 1)?;
    merge(&mut base, table);
    Ok(base)
}

fn merge(base: &mut toml::Table, over: toml::Table) {
    for (key, value) in over {
        match (base.get_mut(&key), value) {
            (Some(toml::Value::Table(base)), toml::Value::Table(over)) => merge(base, over),
            (_, value) => drop(base.insert(key, value)),
        }
    }
}

impl TrainConfig {
    /// Reads and checks a recipe.
    ///
    /// # Errors
    /// If the file cannot be read, a key is unknown or a value is out of bounds.
    pub fn load(path: &Path) -> Result<Self, TrainError> {
        let mut config: Self = toml::Value::Table(inherited(path, 0)?).try_into()?;
        config.base = path.parent().unwrap_or(Path::new(".")).to_path_buf();
        config.check()?;
        Ok(config)
    }

    /// Reads the model preset.
    ///
    /// # Errors
    /// If it cannot be read or is refused.
    pub fn model(&self) -> Result<ModelConfig, TrainError> {
        let mut model = ModelConfig::load(&self.base.join(&self.model))?;
        if let Some(source) = &self.cache_source {
            model.causal.cache_source.clone_from(source);
            // Checked again, for the source must suit the sampler.
            model = ModelConfig::parse(&toml::to_string(&model).expect("a checked preset is TOML"))?;
        }
        Ok(model)
    }

    /// Returns the folder of a clip set.
    pub(crate) fn set(&self, name: &str) -> Result<&Path, TrainError> {
        let refuse = || TrainError::Config { field: "sets", rule: format!("clip set {name:?} is not among [sets]") };
        self.sets.get(name).map(PathBuf::as_path).ok_or_else(refuse)
    }

    /// Returns where a finished stage's file lies: in the work folder, else in the parent's.
    pub(crate) fn finished(&self, file: &str) -> PathBuf {
        let own = self.folder.join(file);
        match &self.parent {
            Some(parent) if !own.exists() => parent.join(file),
            _ => own,
        }
    }

    /// Reads the averaged weights that a stage left.
    pub(crate) fn weights_of(&self, stage: &str) -> Result<Weights, TrainError> {
        Ok(WeightsFile::read(&self.finished(&format!("{stage}.safetensors")))?.weights)
    }

    /// Reads a part of the weights that training starts from; empty without any.
    pub(crate) fn initial(&self, prefix: &str) -> Result<Weights, TrainError> {
        let Some(path) = &self.initial else { return Ok(Weights::default()) };
        Ok(WeightsFile::read(&self.base.join(path))?.weights.part(prefix))
    }

    /// Averages the weights of an autoencoder with those of `averaged_with`, one by one.
    ///
    /// # Errors
    /// If that file cannot be read or holds another network.
    pub(crate) fn averaged(&self, mut weights: Weights) -> Result<Weights, TrainError> {
        let Some(path) = &self.averaged_with else { return Ok(weights) };
        let other = WeightsFile::read(&self.base.join(path))?.weights.part("vae.");
        let shapes = |of: &Weights| {
            of.iter().map(|(name, array)| (name.to_owned(), array.shape().to_vec())).collect::<BTreeMap<_, _>>()
        };
        if shapes(&other) != shapes(&weights) {
            return Err(TrainError::Config { field: "averaged_with", rule: "must hold the same network".to_owned() });
        }
        for (name, array) in other.iter() {
            let own = weights.get(name).map_or(&[][..], Array::values);
            let mean = array.values().iter().zip(own).map(|(a, b)| 0.5 * (a + b)).collect();
            weights.insert(name, Array::new(array.shape(), mean));
        }
        Ok(weights)
    }

    /// Says whether any stage is guided.
    fn guided(&self) -> bool {
        let weights = [
            self.trajectories.as_ref().map(|made| made.guidance),
            self.self_forcing.as_ref().map(|stage| stage.guidance),
        ];
        weights.into_iter().flatten().any(|weight| (weight - 1.0).abs() > f32::EPSILON)
    }

    fn check(&self) -> Result<(), TrainError> {
        let refuse = |field, rule: &str| Err(TrainError::Config { field, rule: rule.to_owned() });
        if self.version != 2 {
            return refuse("version", "must be 2");
        }
        for (field, weight) in [("road_users", self.road_users), ("lights", self.lights)] {
            if !(1.0..=1_000.0).contains(&weight) {
                return refuse(field, "must be 1 to 1000");
            }
        }
        let stages = [
            ("autoencoder", self.autoencoder.as_ref()),
            ("prior", self.prior.as_ref()),
            ("teacher", self.teacher.as_ref().map(|teacher| &teacher.stage)),
            ("ode", self.ode.as_ref().map(|ode| &ode.stage)),
            ("self_forcing", self.self_forcing.as_ref().map(|stage| &stage.stage)),
            ("decoder", self.decoder.as_ref().map(|decoder| &decoder.stage)),
        ];
        for (name, stage) in stages.iter().filter_map(|(name, stage)| Some((*name, (*stage)?))) {
            stage.check(name, &self.sets)?;
        }
        if let Some(teacher) = &self.teacher {
            let dropped = teacher.dropout_share * teacher.dropout.len() as f64;
            if teacher.dropout_share < 0.0 || dropped.is_nan() || dropped >= 1.0 {
                return refuse("teacher", "dropout_share of all that is dropped must lie within [0, 1) together");
            }
            if !(0.0..=1.0).contains(&teacher.trunk_rate) {
                return refuse("teacher", "trunk_rate must be 0 to 1");
            }
            if let Some(set) = teacher.replay.iter().find(|set| !self.sets.contains_key(*set)) {
                return refuse("teacher", &format!("clip set {set:?} is not among [sets]"));
            }
            if self.guided() && !teacher.dropout.contains(&self.unconditional) {
                return refuse("unconditional", "must be among the teacher's dropout where there is guidance");
            }
        }
        let [low, high] = self.guide_levels;
        if low.is_nan() || high.is_nan() || low < 0.0 || low > high || high > 1.0 {
            return refuse("guide_levels", "must be two levels within 0 to 1, the lower one first");
        }
        if self.keep_look && self.unconditional == Dropout::All {
            return refuse("keep_look", "needs unconditional = \"layout\", for c∅ must keep the first frame");
        }
        if !(0.0..1.0).contains(&self.without_first) {
            return refuse("without_first", "must lie within [0, 1)");
        }
        if let Some(made) = &self.trajectories {
            if made.count == 0 || made.latents < 2 || made.steps == 0 || !(0.0..0.9).contains(&made.reject) {
                return refuse("trajectories", "count, latents and steps must be positive and reject within [0, 0.9)");
            }
            if let Some(set) = made.sets.iter().find(|set| !self.sets.contains_key(*set)) {
                return refuse("trajectories", &format!("clip set {set:?} is not among [sets]"));
            }
        }
        if let Some(decoder) = &self.decoder {
            decoder.check()?;
        }
        if let Some(stage) = &self.self_forcing {
            let critic = stage.critic_learning_rate > 0.0 && stage.critic_learning_rate < 1.0;
            if stage.generator_every == 0 || !critic || stage.rollout < stage.stage.latents {
                let rule = "generator_every must be at least 1, critic_learning_rate within (0, 1) and rollout at least latents";
                return refuse("self_forcing", rule);
            }
        }
        Ok(())
    }
}

//! The training configuration: one TOML file, naming the model preset and the work folder.

use std::path::{Path, PathBuf};

use ds_nn::Weights;
use ds_nn::optimiser::{AdamWSettings, Schedule};
use ds_nn::safetensors::WeightsFile;
use ds_video::ModelConfig;
use serde::{Deserialize, Serialize};

use crate::error::TrainError;

/// A training recipe.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// Schema version, 1.
    pub version: u32,
    /// The model preset, relative to the configuration file.
    pub model: PathBuf,
    /// Work folder for clips, checkpoints and logs, relative to the current folder.
    pub folder: PathBuf,
    /// Keys all draws.
    pub seed: u64,
    /// Trained weights of the same model that the stages start from, relative to this file; from draws without one.
    #[serde(default)]
    pub initial: Option<PathBuf>,
    /// Training clips.
    pub data: DataConfig,
    /// The autoencoder's recipe.
    pub autoencoder: StageConfig,
    /// The teacher's recipe.
    pub teacher: StageConfig,
    /// The student's recipe.
    pub student: StageConfig,
    /// The guided decoder's recipe.
    pub decoder: StageConfig,
    /// Where this file lies; model paths start there.
    #[serde(skip)]
    pub base: PathBuf,
}

/// Training clips.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DataConfig {
    /// Clips to render.
    pub clips: u64,
    /// Frames of a clip: 1 + k·stride_t.
    pub frames: usize,
    /// The last clips, kept for evaluation.
    pub held_out: u64,
    /// Training clips that the student is rolled out over for the decoder's stage.
    pub rollouts: u64,
    /// How much more than others a pixel counts whose layout shows a vehicle, a pedestrian or a cyclist.
    #[serde(default = "alike")]
    pub road_users: f32,
}

fn alike() -> f32 {
    1.0
}

/// The recipe of one stage.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StageConfig {
    /// Updates.
    pub steps: u32,
    /// Clips of a batch.
    pub clips: usize,
    /// Latent frames of a clip.
    pub latents: usize,
    /// Highest learning rate.
    pub learning_rate: f32,
    /// Updates until the highest rate.
    pub warm_up: u32,
    /// Decay of the averaged weights.
    pub average: f32,
    /// Updates between checkpoints.
    pub checkpoint_every: u32,
}

impl StageConfig {
    pub(crate) fn schedule(&self) -> Schedule {
        Schedule { peak: self.learning_rate, warm_up: self.warm_up, total: self.steps }
    }

    pub(crate) fn optimiser() -> AdamWSettings {
        AdamWSettings::default()
    }
}

impl TrainConfig {
    /// Reads and checks a recipe.
    ///
    /// # Errors
    /// If the file cannot be read, a key is unknown or a value is out of bounds.
    pub fn load(path: &Path) -> Result<Self, TrainError> {
        let text = std::fs::read_to_string(path).map_err(TrainError::io("training configuration", path))?;
        let mut config: Self = toml::from_str(&text)?;
        config.base = path.parent().unwrap_or(Path::new(".")).to_path_buf();
        config.check()?;
        Ok(config)
    }

    /// Reads the model preset.
    ///
    /// # Errors
    /// If it cannot be read or is refused.
    pub fn model(&self) -> Result<ModelConfig, TrainError> {
        let path = self.base.join(&self.model);
        let text = std::fs::read_to_string(&path).map_err(TrainError::io("model configuration", &path))?;
        Ok(ModelConfig::parse(&text)?)
    }

    /// Reads a part of the weights that training starts from; empty without any.
    pub(crate) fn initial(&self, prefix: &str) -> Result<Weights, TrainError> {
        let Some(path) = &self.initial else { return Ok(Weights::default()) };
        Ok(WeightsFile::read(&self.base.join(path))?.weights.part(prefix))
    }

    fn check(&self) -> Result<(), TrainError> {
        let refuse = |field, rule: &str| Err(TrainError::Config { field, rule: rule.to_owned() });
        if self.version != 1 {
            return refuse("version", "must be 1");
        }
        if self.data.clips <= self.data.held_out || self.data.clips > 1 << 20 || self.data.held_out == 0 {
            return refuse("data.clips", "must be more than held_out (at least 1) and at most 1048576");
        }
        if !(1.0..=1_000.0).contains(&self.data.road_users) {
            return refuse("data.road_users", "must be 1 to 1000");
        }
        if self.data.frames < 2 || self.data.frames > 1_024 {
            return refuse("data.frames", "must be 2 to 1024");
        }
        for (field, stage) in [
            ("autoencoder", &self.autoencoder),
            ("teacher", &self.teacher),
            ("student", &self.student),
            ("decoder", &self.decoder),
        ] {
            let rate = stage.learning_rate > 0.0 && stage.learning_rate < 1.0;
            let average = (0.0..1.0).contains(&stage.average);
            if stage.clips == 0 || stage.clips > 256 || stage.latents < 2 || !rate || !average {
                return refuse(field, "clips must be 1 to 256, latents at least 2, rate and average within (0, 1)");
            }
            if stage.checkpoint_every == 0 {
                return refuse(field, "checkpoint_every must be at least 1");
            }
        }
        Ok(())
    }
}

//! The networks of a drive: the video model with what computes it, and the weights of learned policies.

use std::path::{Path, PathBuf};

use clap::{Args, ValueHint};
use ds_process::shipped;
use ds_video::Backend;
use vdm_worker::VideoStage;

use crate::choice::backend;

const MODEL: &str = "configs/models/cpu_train.toml";
const POLICY_WEIGHTS: &str = "configs/models/camera_policy.safetensors";

/// Which networks make frames and plans.
#[derive(Debug, Clone, PartialEq, Eq, Args)]
pub struct Networks {
    /// Configuration of the video model; its weights lie beside it as .safetensors.
    #[arg(long, default_value = MODEL, value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub model: PathBuf,
    /// What computes the video model: cpu, the fast path of this project, or framework, the machine-learning framework's
    /// graph, several times slower and equal to 1e-4, or that graph on a graphics processor, in builds with that feature; a
    /// replay needs the one that the recording was made with.
    #[arg(long, default_value = "cpu", value_parser = backend(&Backend::ALL))]
    pub video_backend: Backend,
    /// Weights of the camera policy; a policy of the panel has panel/NAME.safetensors beside it, or a file of its name.
    #[arg(long, default_value = POLICY_WEIGHTS, value_parser = shipped::parser(), value_hint = ValueHint::FilePath)]
    pub policy_weights: PathBuf,
}

impl Default for Networks {
    /// Returns the shipped networks.
    fn default() -> Self {
        let [model, policy_weights] = [MODEL, POLICY_WEIGHTS].map(|file| shipped::find(Path::new(file)));
        Self { model, video_backend: Backend::Cpu, policy_weights }
    }
}

impl Networks {
    /// Returns what makes frames, one worker at a time.
    #[must_use]
    pub fn video(&self) -> VideoStage {
        VideoStage::new(self.model.clone(), None).with_backend(self.video_backend)
    }
}

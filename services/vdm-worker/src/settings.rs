//! Settings of vdm-worker: typed and checked; the default suits a fleet on one host.

use std::path::PathBuf;

use ds_process::section::{BusSection, ControlSection, ProcessSection};
use serde::{Deserialize, Serialize};

/// `[video]`: the model.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VideoSection {
    /// The model's configuration.
    pub model: PathBuf,
    /// Its weights; empty for the file beside the configuration that ends in `.safetensors`.
    pub weights: PathBuf,
}

impl Default for VideoSection {
    fn default() -> Self {
        Self { model: PathBuf::from("configs/models/cpu_train.toml"), weights: PathBuf::new() }
    }
}

/// All settings of vdm-worker.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Identity and logging.
    pub process: ProcessSection,
    /// The orchestrator.
    pub control: ControlSection,
    /// The bus.
    pub bus: BusSection,
    /// The model.
    pub video: VideoSection,
}

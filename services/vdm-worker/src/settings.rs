//! Settings of vdm-worker: typed and checked; the default suits a fleet on one host.

use std::path::PathBuf;

use ds_process::section::{BusSection, ControlSection, MetricsSection, ProcessSection, SecuritySection};
use ds_video::Backend;
use serde::{Deserialize, Serialize};

/// `[video]`: the model.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct VideoSection {
    /// The model's configuration.
    pub model: PathBuf,
    /// Its weights; empty for the file beside the configuration that ends in `.safetensors`, or, of a published model, the
    /// folder of the configuration's name.
    pub weights: PathBuf,
    /// The transformer of source `dreamstream-no-guidance`; empty for `arms/no_guidance.safetensors` beside the model.
    pub no_guidance: PathBuf,
    /// Accelerators that it may be given, by any names; empty to list those of the host.
    pub devices: Vec<String>,
    /// Whether it may be given a device that another worker holds.
    pub share_device: bool,
    /// Generate nothing: wait so many seconds for each chunk and return a grey frame; 0 to generate.
    pub simulated_secs: f64,
}

impl Default for VideoSection {
    fn default() -> Self {
        Self {
            model: PathBuf::from("configs/models/cpu_train.toml"),
            weights: PathBuf::new(),
            no_guidance: PathBuf::new(),
            devices: Vec::new(),
            share_device: false,
            simulated_secs: 0.0,
        }
    }
}

/// `[device]`: what computes.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DeviceSection {
    /// `cpu`: the processor's own path; `framework`: the machine-learning framework's graph, several times slower;
    /// `vulkan`, `cuda`: that graph on a graphics processor, in builds with the feature of that name.
    pub backend: Backend,
}

/// All settings of vdm-worker.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Identity and logging.
    pub process: ProcessSection,
    /// The orchestrator.
    pub control: ControlSection,
    /// Certificates and token.
    pub security: SecuritySection,
    /// The bus.
    pub bus: BusSection,
    /// Where Prometheus asks.
    pub metrics: MetricsSection,
    /// The model.
    pub video: VideoSection,
    /// What computes.
    pub device: DeviceSection,
}

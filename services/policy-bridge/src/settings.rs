//! Settings of policy-bridge: typed and checked; the default suits a fleet on one host.

use std::path::PathBuf;

use ds_process::section::{BusSection, ControlSection, MetricsSection, ProcessSection, SecuritySection};
use serde::{Deserialize, Serialize};

/// `[policy]`: the guests.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PolicySection {
    /// Weights of the camera policy.
    pub weights: PathBuf,
    /// Manifests of policies of one's own that run inside.
    pub manifests: Vec<PathBuf>,
    /// The external policy that may connect, by its name.
    pub name: String,
    /// Where it connects to, such as `tcp/127.0.0.1:7448`; empty for none.
    pub listen: String,
    /// How long an external policy may think, in milliseconds.
    pub deadline_millis: u64,
}

impl Default for PolicySection {
    fn default() -> Self {
        Self {
            weights: PathBuf::from("configs/models/camera_policy.safetensors"),
            manifests: Vec::new(),
            name: "mine".to_owned(),
            listen: String::new(),
            deadline_millis: 10_000,
        }
    }
}

/// All settings of policy-bridge.
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
    /// The guests.
    pub policy: PolicySection,
}

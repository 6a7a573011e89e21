//! Settings of layout-render: typed and checked; the default suits a fleet on one host.

use ds_process::section::{BusSection, ControlSection, MetricsSection, ProcessSection, SecuritySection};
use serde::{Deserialize, Serialize};

/// `[layout]`: the renderers.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LayoutSection {
    /// Whether to look for a graphics adapter at the start.
    pub probe: bool,
}

impl Default for LayoutSection {
    fn default() -> Self {
        Self { probe: true }
    }
}

/// All settings of layout-render.
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
    /// The renderers.
    pub layout: LayoutSection,
}

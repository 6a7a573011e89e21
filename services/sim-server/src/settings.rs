//! Settings of sim-server: typed and checked; the default suits a fleet on one host.

use ds_process::section::{BusSection, ControlSection, MetricsSection, ProcessSection, SecuritySection};
use serde::{Deserialize, Serialize};

/// All settings of sim-server.
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
}

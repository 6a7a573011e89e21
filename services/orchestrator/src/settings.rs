//! Settings of the orchestrator: typed and checked; the default is the embedded run.

use std::path::PathBuf;

use ds_process::section::{BusSection, MetricsSection, ProcessSection, SecuritySection};
use ds_process::settings::SettingsError;
use serde::{Deserialize, Serialize};

/// `[control]`: the gRPC server.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ServerSection {
    /// Where it listens; port 0 takes a free one.
    pub listen: String,
}

impl Default for ServerSection {
    fn default() -> Self {
        Self { listen: "127.0.0.1:4710".to_owned() }
    }
}

/// `[journal]`: where everything durable lies.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct JournalSection {
    /// The folder of the ledger, the recordings and the submitted scenarios.
    pub folder: PathBuf,
}

impl Default for JournalSection {
    fn default() -> Self {
        Self { folder: PathBuf::from("runs") }
    }
}

/// `[fleet]`: leases and limits.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FleetSection {
    /// Length of a lease, in milliseconds.
    pub lease_millis: u64,
    /// How long after its end a role is given to another, in milliseconds.
    pub margin_millis: u64,
    /// How often an instance says that it lives, in milliseconds.
    pub heartbeat_millis: u64,
    /// Episodes under way at a time.
    pub episodes: u32,
    /// Attempts at an episode after infrastructure faults.
    pub attempts: u32,
    /// When a missing message is asked for, in milliseconds.
    pub pull_after_millis: u64,
    /// How long an iteration may take, in milliseconds.
    pub iteration_deadline_millis: u64,
    /// How long a role may stay without a holder, in milliseconds.
    pub vacancy_deadline_millis: u64,
}

impl Default for FleetSection {
    fn default() -> Self {
        Self {
            lease_millis: 6_000,
            margin_millis: 1_000,
            heartbeat_millis: 1_000,
            episodes: 4,
            attempts: 3,
            pull_after_millis: 200,
            iteration_deadline_millis: 300_000,
            vacancy_deadline_millis: 120_000,
        }
    }
}

/// All settings of the orchestrator.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Identity and logging.
    pub process: ProcessSection,
    /// The gRPC server.
    pub control: ServerSection,
    /// Certificates and token.
    pub security: SecuritySection,
    /// The bus.
    pub bus: BusSection,
    /// Where Prometheus asks.
    pub metrics: MetricsSection,
    /// Everything durable.
    pub journal: JournalSection,
    /// Leases and limits.
    pub fleet: FleetSection,
}

impl Settings {
    /// Checks what types cannot say.
    ///
    /// # Errors
    /// [`SettingsError::Bounds`] names the key.
    pub fn check(&self) -> Result<(), SettingsError> {
        let fleet = &self.fleet;
        let bounds = |key, value: u64, why| SettingsError::Bounds { key, value: value.to_string(), why };
        if fleet.lease_millis < 3 * fleet.heartbeat_millis {
            return Err(bounds("fleet.lease_millis", fleet.lease_millis, "at least three heartbeats"));
        }
        if fleet.heartbeat_millis < 20 {
            return Err(bounds("fleet.heartbeat_millis", fleet.heartbeat_millis, "at least 20"));
        }
        if fleet.episodes == 0 || fleet.episodes > 1_024 {
            return Err(bounds("fleet.episodes", u64::from(fleet.episodes), "1 to 1024"));
        }
        if fleet.attempts == 0 || fleet.attempts > 100 {
            return Err(bounds("fleet.attempts", u64::from(fleet.attempts), "1 to 100"));
        }
        Ok(())
    }
}

//! The sections that the settings of all processes share.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// `[process]`: who the process is and what it says.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ProcessSection {
    /// The instance; empty to make one up from service, host and random bits.
    pub instance: String,
    /// Log filter.
    pub log: String,
    /// Episodes that it can hold at once.
    pub slots: u32,
    /// How long unfinished work may take after a drain, in seconds.
    pub drain_secs: u64,
}

impl Default for ProcessSection {
    fn default() -> Self {
        Self { instance: String::new(), log: "info".to_owned(), slots: 4, drain_secs: 20 }
    }
}

/// `[control]`: where the orchestrator is.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ControlSection {
    /// Its gRPC address.
    pub orchestrator: String,
}

impl Default for ControlSection {
    fn default() -> Self {
        Self { orchestrator: "http://127.0.0.1:4710".to_owned() }
    }
}

/// `[security]`: how it proves who it is on a network. Loopback needs none of it.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SecuritySection {
    /// The authority that signs all certificates, PEM; empty for links without TLS.
    pub ca: PathBuf,
    /// The own certificate, PEM.
    pub certificate: PathBuf,
    /// The key to it, PEM.
    pub key: PathBuf,
    /// A file with the token that the orchestrator asks for.
    pub token: PathBuf,
    /// Speak without TLS and token beyond loopback; the results say so.
    pub insecure: bool,
}

/// `[bus]`: how the process reaches the data plane.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BusSection {
    /// `client` of a router, `peer`, or `router`.
    pub mode: String,
    /// Endpoints to connect to, such as `tcp/127.0.0.1:7447`.
    pub connect: Vec<String>,
    /// Endpoints to listen on.
    pub listen: Vec<String>,
    /// Test aid: share of pushes that are dropped, 0 to 1.
    pub drop_share: f64,
    /// Seed of those drops.
    pub drop_seed: u64,
}

impl Default for BusSection {
    fn default() -> Self {
        Self {
            mode: "client".to_owned(),
            connect: vec!["tcp/127.0.0.1:7447".to_owned()],
            listen: Vec::new(),
            drop_share: 0.0,
            drop_seed: 0,
        }
    }
}

/// `[metrics]`: where Prometheus asks.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MetricsSection {
    /// Where `GET /metrics` is answered, such as `127.0.0.1:9464`; empty for nowhere.
    pub listen: String,
}

//! Arguments of the commands about a fleet: how to reach it, its services, certificates, health.

use std::path::PathBuf;

use clap::{Args, ValueHint};
use ds_process::section::SecuritySection;
use ds_process::security::Dial;

/// How to reach the orchestrator of a fleet.
#[derive(Debug, Args)]
pub(crate) struct ControlArgs {
    /// The orchestrator's address.
    #[arg(
        long,
        visible_alias = "control",
        env = "DREAMSTREAM_CONTROL_ORCHESTRATOR",
        default_value = "http://127.0.0.1:4710"
    )]
    pub orchestrator: String,
    /// The authority that signed the orchestrator's certificate, for https addresses (see `dreamstream certs`).
    #[arg(long, env = "DREAMSTREAM_SECURITY_CA", value_hint = ValueHint::FilePath)]
    pub ca: Option<PathBuf>,
    /// The file with the token that the orchestrator asks for.
    #[arg(long, env = "DREAMSTREAM_SECURITY_TOKEN", value_hint = ValueHint::FilePath)]
    pub token: Option<PathBuf>,
    /// Speak to an orchestrator on another host without TLS.
    #[arg(long, env = "DREAMSTREAM_SECURITY_INSECURE")]
    pub insecure: bool,
}

/// Arguments of `why`.
#[derive(Debug, Args)]
pub(crate) struct WhyArgs {
    /// The episode, or a part of its name; all drives under way without it.
    pub episode: Option<String>,
    /// The fleet.
    #[command(flatten)]
    pub control: ControlArgs,
}

/// Arguments of `certs`.
#[derive(Debug, Args)]
pub(crate) struct CertsArgs {
    /// Where the files go; existing files are kept, missing ones are made.
    #[arg(long, short, default_value = "certs", value_hint = ValueHint::DirPath)]
    pub out: PathBuf,
    /// Another name or address that router and orchestrator are reached under; may be given several times.
    #[arg(long = "host")]
    pub hosts: Vec<String>,
    /// The name of an external policy that gets a certificate; may be given several times.
    #[arg(long = "policy")]
    pub policies: Vec<String>,
    /// For how long the certificates hold, in days.
    #[arg(long, default_value_t = 365, value_parser = clap::value_parser!(u32).range(1..=3650))]
    pub days: u32,
}

/// Arguments of `serve`.
#[derive(Debug, Args)]
pub(crate) struct ServeArgs {
    /// The service: router, orchestrator, sim-server, layout-render, vdm-worker or policy-bridge.
    #[arg(value_parser = ["router", "orchestrator", "sim-server", "layout-render", "vdm-worker", "policy-bridge"])]
    pub service: String,
    /// Its settings file.
    #[arg(long, value_hint = ValueHint::FilePath)]
    pub config: Option<PathBuf>,
    /// A setting as section.key=value, stronger than file and environment.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    pub set: Vec<String>,
}

/// Arguments of `health`.
#[derive(Debug, Args)]
pub(crate) struct HealthArgs {
    /// The fleet.
    #[command(flatten)]
    pub control: ControlArgs,
    /// An instance that must be a member of the fleet; without it the orchestrator itself is asked.
    #[arg(long)]
    pub instance: Option<String>,
}

impl ControlArgs {
    /// Returns how to reach the orchestrator.
    ///
    /// # Errors
    /// If the address is none, a file cannot be read, or the address is in clear beyond loopback.
    pub(crate) fn dial(&self) -> anyhow::Result<Dial> {
        let (ca, token) = (self.ca.clone().unwrap_or_default(), self.token.clone().unwrap_or_default());
        let security = SecuritySection { ca, token, insecure: self.insecure, ..SecuritySection::default() };
        Dial::new(&self.orchestrator, &security)
    }
}

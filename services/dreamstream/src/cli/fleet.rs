//! Arguments of the commands about a fleet: how to reach it, its services, certificates, health.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Args, ValueHint};
use ds_process::onlooker::ControlArgs;

/// Arguments of `why`.
#[derive(Debug, Args)]
pub(crate) struct WhyArgs {
    /// The episode, or a part of its name; all drives under way without it.
    pub episode: Option<String>,
    /// The fleet.
    #[command(flatten)]
    pub control: ControlArgs,
}

/// Arguments of `top`.
#[derive(Debug, Args)]
pub(crate) struct TopArgs {
    /// Look once.
    #[arg(long)]
    pub once: bool,
    /// Print JSON, one object a look.
    #[arg(long)]
    pub json: bool,
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
    /// Answer Prometheus at this address, such as 127.0.0.1:9464: the setting metrics.listen. The router counts nothing.
    #[arg(long, value_name = "ADDRESS")]
    pub metrics: Option<SocketAddr>,
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

//! Start and stop of a service: logging, settings, bus, fleet, drain; the same order in every process.

use std::fs::File;
use std::future::Future;
use std::io::{ErrorKind, Read};
use std::net::SocketAddr;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result};
use clap::Parser;
use ds_bus::{BusSession, BusSettings, Mode};
use ds_episode::Timing;
use ds_episode::fleet::LedgerError;
use ds_space::InstanceId;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::maker::MakerFactory;
use crate::metrics::Metrics;
use crate::section::{BusSection, ControlSection, MetricsSection, ProcessSection, SecuritySection};
use crate::security::Dial;
use crate::settings::{self, Sources};
use crate::{Drain, Member, drain, logging};

/// Exit code for wrong settings or arguments (`EX_USAGE`).
pub const EXIT_USAGE: u8 = 64;
/// Exit code where what must be kept cannot be written, such as on a full disk (`EX_IOERR`).
pub const EXIT_STORAGE: u8 = 74;

/// What must be kept cannot be written; what was kept before stays sound.
#[derive(Debug, thiserror::Error)]
#[error("storage failed: {0}")]
pub struct StorageError(pub String);

/// Arguments or settings that parse and cannot be meant.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct UsageError(pub String);

/// A signal ended the work before its time; how to go on.
#[derive(Debug, thiserror::Error)]
#[error("interrupted; {0}")]
pub struct InterruptedError(pub String);

/// Returns the exit code of a failed process: [`EXIT_USAGE`] for a [`UsageError`], [`drain::EXIT_INTERRUPTED`] for an
/// [`InterruptedError`], [`EXIT_STORAGE`] where ledger, journal or file system say that nothing more can be kept, else 1.
#[must_use]
pub fn exit_code(error: &anyhow::Error) -> u8 {
    let full = |error: &std::io::Error| {
        matches!(error.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded | ErrorKind::FileTooLarge)
    };
    let storage = |cause: &(dyn std::error::Error + 'static)| {
        cause.is::<StorageError>()
            || matches!(cause.downcast_ref(), Some(LedgerError::Storage(_)))
            || cause.downcast_ref().is_some_and(full)
    };
    if error.chain().any(|cause| cause.is::<UsageError>()) {
        EXIT_USAGE
    } else if error.chain().any(|cause| cause.is::<InterruptedError>()) {
        drain::EXIT_INTERRUPTED
    } else if error.chain().any(storage) {
        EXIT_STORAGE
    } else {
        1
    }
}

/// Arguments that every service takes.
#[derive(Debug, Parser)]
#[command(version)]
struct Arguments {
    /// The settings file.
    #[arg(long)]
    config: Option<PathBuf>,
    /// A setting as section.key=value, stronger than file and environment.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    set: Vec<String>,
    /// Answer Prometheus at this address, such as 127.0.0.1:9464; the same as the setting metrics.listen.
    #[arg(long, value_name = "ADDRESS")]
    metrics: Option<SocketAddr>,
}

/// The main function of a service: exit code 64 for wrong settings, 74 where nothing more can be stored, 1 for another
/// failure, 0 otherwise.
pub fn main<S, F>(run: impl FnOnce(S, Drain) -> F) -> ExitCode
where
    S: Serialize + DeserializeOwned + Default,
    F: Future<Output = Result<()>>,
{
    let arguments = Arguments::parse();
    let set = [arguments.set, metrics_setting(arguments.metrics)].concat();
    start(arguments.config.as_deref(), &set, run)
}

/// Returns what the flag `--metrics` sets.
#[must_use]
pub fn metrics_setting(address: Option<SocketAddr>) -> Vec<String> {
    address.map(|address| format!("metrics.listen=\"{address}\"")).into_iter().collect()
}

/// Loads the settings and runs a service until SIGINT or SIGTERM.
pub fn start<S, F>(config: Option<&std::path::Path>, set: &[String], run: impl FnOnce(S, Drain) -> F) -> ExitCode
where
    S: Serialize + DeserializeOwned + Default,
    F: Future<Output = Result<()>>,
{
    let settings: S = match settings::load(&Sources::of_process(config, set)) {
        Ok(settings) => settings,
        Err(error) => return refuse(&anyhow::Error::new(error)),
    };
    let filter = toml::Table::try_from(&settings).ok().and_then(|table| log_filter(&table));
    if let Err(error) = logging::start(filter.as_deref().unwrap_or("info")) {
        return refuse(&error);
    }
    let runtime = match tokio::runtime::Builder::new_multi_thread().enable_all().worker_threads(2).build() {
        Ok(runtime) => runtime,
        Err(error) => return refuse(&anyhow::Error::new(error)),
    };
    let result = runtime.block_on(async {
        let drain = drain::on_signals()?;
        run(settings, drain).await
    });
    runtime.shutdown_timeout(Duration::from_secs(2));
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tracing::error!("{error:#}");
            ExitCode::from(exit_code(&error))
        }
    }
}

fn log_filter(settings: &toml::Table) -> Option<String> {
    Some(settings.get("process")?.get("log")?.as_str()?.to_owned())
}

fn refuse(error: &anyhow::Error) -> ExitCode {
    logging::complain(error);
    ExitCode::from(EXIT_USAGE)
}

/// Opens the bus that the settings name.
///
/// # Errors
/// If an endpoint cannot be reached or listened on.
pub async fn open_bus(section: &BusSection, security: &SecuritySection) -> Result<BusSession> {
    for (key, endpoints) in [("bus.connect", &section.connect), ("bus.listen", &section.listen)] {
        endpoints.iter().try_for_each(|endpoint| security.check_endpoint(key, endpoint))?;
    }
    let mode = match section.mode.as_str() {
        "client" => Mode::Client,
        "peer" => Mode::Peer,
        "router" => Mode::Router,
        other => anyhow::bail!("setting \"bus.mode\" is {other:?}: client, peer or router"),
    };
    let settings = BusSettings {
        mode,
        connect: section.connect.clone(),
        listen: section.listen.clone(),
        tls: security.files(),
        drop_share: section.drop_share,
        drop_seed: section.drop_seed,
        ..BusSettings::default()
    };
    BusSession::open(&settings).await.context("bus")
}

/// Returns the configured instance name, or one made of service, host and 64 random bits: process ids are equal in
/// containers, and a restart must be a new instance.
///
/// # Errors
/// If the configured name is not an id, or the system gives no random bits.
pub fn instance(section: &ProcessSection, service: &str) -> Result<InstanceId> {
    let name = if section.instance.is_empty() {
        let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
        let host: String = host.chars().filter(|c| c.is_ascii_alphanumeric() || *c == '-').take(24).collect();
        let mut bits = [0_u8; 8];
        File::open("/dev/urandom").and_then(|mut file| file.read_exact(&mut bits)).context("draw an instance name")?;
        format!("{service}-{host}-{:016x}", u64::from_le_bytes(bits))
    } else {
        section.instance.clone()
    };
    InstanceId::new(&name).context("setting \"process.instance\"")
}

/// What a stage's process is told of itself and of who it works with.
#[derive(Debug, Clone, Copy)]
pub struct StageSections<'a> {
    /// Its instance and slots.
    pub process: &'a ProcessSection,
    /// Where the orchestrator is.
    pub control: &'a ControlSection,
    /// Certificates and tokens.
    pub security: &'a SecuritySection,
    /// The bus.
    pub bus: &'a BusSection,
    /// Where Prometheus asks.
    pub metrics: &'a MetricsSection,
}

/// Runs the process of a stage: bus, fleet, makers, until `drain`.
///
/// # Errors
/// If the bus, the orchestrator's address or that of the metrics is bad.
pub async fn run_stage(
    service: &'static str,
    sections: StageSections<'_>,
    factory: Arc<dyn MakerFactory>,
    drain: Drain,
) -> Result<()> {
    let StageSections { process, control, security, bus, metrics: section } = sections;
    let metrics = Metrics::default();
    let answered = metrics.open(section, security, drain.clone())?;
    let bus = open_bus(bus, security).await?;
    metrics.add_process(service, &bus);
    let member = Member {
        instance: instance(process, service)?,
        slots: process.slots,
        orchestrator: Dial::new(&control.orchestrator, security)?,
        bus,
        factory,
        codec: Arc::new(ds_wire::WireCodec),
        timing: Timing::default(),
        metrics,
    };
    tracing::info!(instance = %member.instance, orchestrator = member.orchestrator.address(), "started");
    let worked = async {
        member.run(drain).await;
        Ok(())
    };
    tokio::try_join!(answered, worked)?;
    Ok(())
}

//! `serve`: one service of a fleet in the foreground, the same libraries as the service's own binary.

use std::process::ExitCode;

use ds_process::section::{BusSection, ProcessSection, SecuritySection};
use ds_process::{Drain, service};
use serde::{Deserialize, Serialize};

use crate::cli::ServeArgs;

/// Settings of the Zenoh router that a fleet shares.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct RouterSettings {
    process: ProcessSection,
    security: SecuritySection,
    bus: BusSection,
}

/// Runs the service until SIGINT or SIGTERM; a log filter of the command line is its setting `process.log`.
pub(crate) fn run(args: &ServeArgs, log: Option<&str>) -> ExitCode {
    let log = log.map(|filter| format!("process.log={filter:?}"));
    let set = [Vec::from_iter(log), args.set.clone(), service::metrics_setting(args.metrics)].concat();
    let (config, set) = (args.config.as_deref(), set.as_slice());
    match args.service.as_str() {
        "router" => service::start(config, set, route),
        "orchestrator" => service::start(config, set, orchestrator::run),
        "sim-server" => service::start(config, set, sim_server::run),
        "layout-render" => service::start(config, set, layout_render::run),
        "vdm-worker" => service::start(config, set, vdm_worker::run),
        _ => service::start(config, set, policy_bridge::run),
    }
}

async fn route(settings: RouterSettings, drain: Drain) -> anyhow::Result<()> {
    let bus = service::open_bus(&settings.bus, &settings.security).await?;
    tracing::info!(listen = ?settings.bus.listen, "router ready");
    drain.cancelled().await;
    Ok(bus.close().await?)
}

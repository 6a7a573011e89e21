//! The five services and a router as child processes over loopback; the same binary, the same libraries.

use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result};
use ds_process::children::{Children, Launch};
use ds_process::service::metrics_setting;
use ds_topic::Role;

use crate::fleet_plan::FleetPlan;

/// Child processes, and where one meets them.
pub struct Meeting {
    /// The orchestrator's address.
    pub control: String,
    /// The router's endpoint.
    pub router: String,
    /// The processes.
    pub children: Children,
}

fn free_port() -> Result<u16> {
    ds_bus::free_port("127.0.0.1").context("no free port on loopback")
}

fn set(key: &str, value: &str) -> String {
    format!("{key}={}", toml::Value::String(value.to_owned()))
}

fn path(path: &Path) -> Result<String> {
    path.to_str().map(str::to_owned).with_context(|| format!("path {path:?} is not UTF-8"))
}

/// Starts router, orchestrator and stages, and waits until the orchestrator answers.
///
/// # Errors
/// If a process cannot be started or does not come up.
pub async fn start(plan: &FleetPlan, log: &str) -> Result<Meeting> {
    let (bus_port, control_port) = (free_port()?, free_port()?);
    let endpoint = format!("tcp/127.0.0.1:{bus_port}");
    let control = format!("http://127.0.0.1:{control_port}");
    let connect = format!("bus.connect=[\"{endpoint}\"]");
    let log = set("process.log", log);
    let drop_share = format!("bus.drop_share={:?}", plan.drop_pushes);
    let mut children = Children::default();
    let router = [set("bus.mode", "router"), "bus.connect=[]".to_owned(), format!("bus.listen=[\"{endpoint}\"]")];
    spawn(&mut children, "router", "router", &[&log, &router[0], &router[1], &router[2]])?;
    wait_for_port(bus_port).await?;
    let listen = set("control.listen", &format!("127.0.0.1:{control_port}"));
    let folder = set("journal.folder", &path(&plan.folder)?);
    let episodes = format!("fleet.episodes={}", plan.workers);
    let metrics = metrics_setting(plan.metrics);
    let settings = [&log, &connect, &drop_share, &listen, &folder, &episodes].map(String::as_str);
    let settings: Vec<&str> = settings.into_iter().chain(metrics.iter().map(String::as_str)).collect();
    spawn(&mut children, "orchestrator", "orchestrator", &settings)?;
    wait_for_port(control_port).await?;
    let common = [log, connect, drop_share, set("control.orchestrator", &control)];
    for role in Role::ALL {
        let copies = if role == Role::Video { plan.workers } else { 1 };
        for index in 0..copies {
            match plan.stages.get(&role) {
                Some(command) => take_place(&mut children, role, command, [&control, &endpoint])?,
                None => {
                    let (service, own) = settings_of(role, plan)?;
                    let name = if role == Role::Video { format!("{service}-{index}") } else { service.to_owned() };
                    let settings: Vec<&str> = common.iter().chain(&own).map(String::as_str).collect();
                    spawn(&mut children, &name, service, &settings)?;
                }
            }
        }
    }
    Ok(Meeting { control, router: endpoint, children })
}

/// Returns the service of a role and the settings that are its own.
fn settings_of(role: Role, plan: &FleetPlan) -> Result<(&'static str, Vec<String>)> {
    let slots = format!("process.slots={}", plan.workers);
    Ok(match role {
        Role::Sim => ("sim-server", vec![slots]),
        Role::Layout => ("layout-render", vec![slots, format!("layout.probe={}", plan.probe_adapter)]),
        Role::Video => {
            let backend = set("device.backend", plan.networks.video_backend.name());
            let simulated = format!("video.simulated_secs={:?}", plan.simulated_secs);
            let model = set("video.model", &path(&plan.networks.model)?);
            ("vdm-worker", vec!["process.slots=1".to_owned(), model, backend, simulated])
        }
        Role::Policy => {
            let weights = set("policy.weights", &path(&plan.networks.policy_weights)?);
            let listen = set("policy.listen", plan.policy_listen.as_deref().unwrap_or_default());
            let manifests = plan.manifests.iter().map(|manifest| Ok(toml::Value::String(path(manifest)?)));
            let manifests = toml::Value::Array(manifests.collect::<Result<_>>()?);
            let own = format!("policy.manifests={manifests}");
            ("policy-bridge", vec![slots, weights, own, set("policy.name", &plan.policy), listen])
        }
    })
}

async fn wait_for_port(port: u16) -> Result<()> {
    let up = async {
        while tokio::net::TcpStream::connect(("127.0.0.1", port)).await.is_err() {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    };
    tokio::time::timeout(Duration::from_secs(30), up).await.with_context(|| format!("nothing listens on port {port}"))
}

fn spawn(children: &mut Children, name: &str, service: &str, settings: &[&str]) -> Result<()> {
    let mut arguments = vec!["serve".to_owned(), service.to_owned()];
    for setting in settings {
        arguments.extend(["--set".to_owned(), (*setting).to_owned()]);
    }
    let program = std::env::current_exe().context("path of this binary")?;
    children.add(name, Launch { program, arguments, environment: Vec::new() })
}

/// Starts a program that takes a stage's place; it finds orchestrator and router in its environment.
fn take_place(children: &mut Children, role: Role, command: &str, [control, router]: [&String; 2]) -> Result<()> {
    let environment =
        vec![("DREAMSTREAM_CONTROL_ORCHESTRATOR", control.clone()), ("DREAMSTREAM_BUS_ROUTER", router.clone())];
    // `exec`: a signal reaches the program, not a shell around it.
    let arguments = vec!["-c".to_owned(), format!("exec {command}")];
    children.add(role.name(), Launch { program: "sh".into(), arguments, environment })
}

//! The five services and a router as child processes over loopback; the same binary, the same libraries.

use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

use anyhow::{Context, Result};
use ds_topic::Role;
use tokio::process::{Child, Command};

use crate::embed::{Fleet, FleetPlan};

/// How often a process that died is started again before the run gives up.
const MAX_RESTARTS: u32 = 8;

/// A command line with what its environment says besides.
#[derive(Clone)]
struct Launch {
    program: PathBuf,
    arguments: Vec<String>,
    environment: Vec<(&'static str, String)>,
}

struct Supervised {
    name: String,
    launch: Launch,
    child: Child,
    restarts: u32,
}

/// Running child processes in order of start. One that dies is started again: its roles are taken over by epoch, its
/// journal goes on from the last commit.
pub(crate) struct Children(Vec<Supervised>);

fn free_port() -> Result<u16> {
    let listener = TcpListener::bind("127.0.0.1:0").context("no free port on loopback")?;
    Ok(listener.local_addr().context("port of a listener")?.port())
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
pub(crate) async fn start(plan: &FleetPlan, log: &str) -> Result<Fleet> {
    let (bus_port, control_port) = (free_port()?, free_port()?);
    let endpoint = format!("tcp/127.0.0.1:{bus_port}");
    let control = format!("http://127.0.0.1:{control_port}");
    let connect = format!("bus.connect=[\"{endpoint}\"]");
    let log = set("process.log", log);
    let drop_share = format!("bus.drop_share={:?}", plan.drop_pushes);
    let mut children = Children(Vec::new());
    let router = [set("bus.mode", "router"), "bus.connect=[]".to_owned(), format!("bus.listen=[\"{endpoint}\"]")];
    children.spawn("router", "router", &[&log, &router[0], &router[1], &router[2]])?;
    wait_for_port(bus_port).await?;
    let listen = set("control.listen", &format!("127.0.0.1:{control_port}"));
    let folder = set("journal.folder", &path(&plan.folder)?);
    let episodes = format!("fleet.episodes={}", plan.workers);
    children.spawn("orchestrator", "orchestrator", &[&log, &connect, &drop_share, &listen, &folder, &episodes])?;
    wait_for_port(control_port).await?;
    let common = [log, connect, drop_share, set("control.orchestrator", &control)];
    for role in Role::ALL {
        let copies = if role == Role::Video { plan.workers } else { 1 };
        for index in 0..copies {
            match plan.stages.get(&role) {
                Some(command) => children.take_place(role, command, [&control, &endpoint])?,
                None => {
                    let (service, own) = settings_of(role, plan)?;
                    let name = if role == Role::Video { format!("{service}-{index}") } else { service.to_owned() };
                    let settings: Vec<&str> = common.iter().chain(&own).map(String::as_str).collect();
                    children.spawn(&name, service, &settings)?;
                }
            }
        }
    }
    Ok(Fleet::of_children(control, endpoint, children))
}

/// Returns the service of a role and the settings that are its own.
fn settings_of(role: Role, plan: &FleetPlan) -> Result<(&'static str, Vec<String>)> {
    let slots = format!("process.slots={}", plan.workers);
    Ok(match role {
        Role::Sim => ("sim-server", vec![slots]),
        Role::Layout => ("layout-render", vec![slots, format!("layout.probe={}", plan.probe_adapter)]),
        Role::Video => {
            let backend = set("device.backend", plan.video_backend.name());
            ("vdm-worker", vec!["process.slots=1".to_owned(), set("video.model", &path(&plan.model)?), backend])
        }
        Role::Policy => {
            let weights = set("policy.weights", &path(&plan.policy_weights)?);
            let listen = set("policy.listen", plan.policy_listen.as_deref().unwrap_or_default());
            ("policy-bridge", vec![slots, weights, set("policy.name", &plan.policy), listen])
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

fn launch(name: &str, launch: &Launch) -> Result<Child> {
    let mut command = Command::new(&launch.program);
    command.args(&launch.arguments).envs(launch.environment.iter().map(|(key, value)| (key, value)));
    command.stdin(Stdio::null()).stdout(Stdio::null()).kill_on_drop(true);
    let child = command.spawn().with_context(|| format!("start {name}"))?;
    tracing::info!(name, pid = child.id(), "process started");
    Ok(child)
}

impl Children {
    fn spawn(&mut self, name: &str, service: &str, settings: &[&str]) -> Result<()> {
        let mut arguments = vec!["serve".to_owned(), service.to_owned()];
        for setting in settings {
            arguments.extend(["--set".to_owned(), (*setting).to_owned()]);
        }
        let program = std::env::current_exe().context("path of this binary")?;
        self.add(name, Launch { program, arguments, environment: Vec::new() })
    }

    /// Starts a program that takes a stage's place; it finds orchestrator and router in its environment.
    fn take_place(&mut self, role: Role, command: &str, [control, router]: [&String; 2]) -> Result<()> {
        let environment =
            vec![("DREAMSTREAM_CONTROL_ORCHESTRATOR", control.clone()), ("DREAMSTREAM_BUS_ROUTER", router.clone())];
        // `exec`: a signal reaches the program, not a shell around it.
        let arguments = vec!["-c".to_owned(), format!("exec {command}")];
        self.add(role.name(), Launch { program: "sh".into(), arguments, environment })
    }

    fn add(&mut self, name: &str, way: Launch) -> Result<()> {
        let child = launch(name, &way)?;
        self.0.push(Supervised { name: name.to_owned(), launch: way, child, restarts: 0 });
        Ok(())
    }

    /// Watches the processes and starts dead ones again; returns when one has died too often.
    pub(crate) async fn supervise(&mut self) -> anyhow::Error {
        loop {
            for process in &mut self.0 {
                let status = match process.child.try_wait() {
                    Ok(None) => continue,
                    Ok(Some(status)) => status,
                    Err(error) => return anyhow::anyhow!("process {} cannot be watched: {error}", process.name),
                };
                if process.restarts == MAX_RESTARTS || status.code() == Some(i32::from(ds_process::service::EXIT_USAGE))
                {
                    return anyhow::anyhow!("process {} ended: {status}", process.name);
                }
                tracing::warn!(name = process.name, %status, "process died and is started again");
                process.restarts += 1;
                match launch(&process.name, &process.launch) {
                    Ok(child) => process.child = child,
                    Err(error) => return error,
                }
            }
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    }

    /// Sends SIGTERM to all, the last started first, and waits for their end.
    ///
    /// # Errors
    /// If a process cannot be signalled or does not end.
    pub(crate) async fn stop(mut self) -> Result<()> {
        while let Some(Supervised { name, mut child, .. }) = self.0.pop() {
            if let Some(pid) = child.id() {
                let killed = Command::new("kill").arg("-TERM").arg(pid.to_string()).status().await;
                killed.with_context(|| format!("signal {name}"))?;
            }
            if tokio::time::timeout(Duration::from_secs(10), child.wait()).await.is_err() {
                tracing::warn!(name, "did not drain in 10 s, killed");
                child.kill().await.with_context(|| format!("kill {name}"))?;
            }
        }
        Ok(())
    }
}

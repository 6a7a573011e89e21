//! The five services and a router as child processes over loopback; the same binary, the same libraries.

use std::net::TcpListener;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

use anyhow::{Context, Result};
use tokio::process::{Child, Command};

use crate::embed::{Fleet, FleetPlan};

/// How often a process that died is started again before the run gives up.
const MAX_RESTARTS: u32 = 8;

struct Supervised {
    name: String,
    arguments: Vec<String>,
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
    let orchestrator = set("control.orchestrator", &control);
    let common = [log.as_str(), connect.as_str(), drop_share.as_str(), orchestrator.as_str()];
    let slots = format!("process.slots={}", plan.workers);
    let weights = set("policy.weights", &path(&plan.policy_weights)?);
    let policy_name = set("policy.name", &plan.policy);
    let policy_listen = set("policy.listen", plan.policy_listen.as_deref().unwrap_or_default());
    let model = set("video.model", &path(&plan.model)?);
    children.spawn("sim-server", "sim-server", &[&common[..], &[&slots]].concat())?;
    let probe = format!("layout.probe={}", plan.probe_adapter);
    children.spawn("layout-render", "layout-render", &[&common[..], &[&slots, &probe]].concat())?;
    children.spawn(
        "policy-bridge",
        "policy-bridge",
        &[&common[..], &[&slots, &weights, &policy_name, &policy_listen]].concat(),
    )?;
    for index in 0..plan.workers {
        let name = format!("vdm-worker-{index}");
        children.spawn(&name, "vdm-worker", &[&common[..], &["process.slots=1", &model]].concat())?;
    }
    Ok(Fleet::of_children(control, endpoint, children))
}

async fn wait_for_port(port: u16) -> Result<()> {
    let up = async {
        while tokio::net::TcpStream::connect(("127.0.0.1", port)).await.is_err() {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    };
    tokio::time::timeout(Duration::from_secs(30), up).await.with_context(|| format!("nothing listens on port {port}"))
}

fn launch(name: &str, arguments: &[String]) -> Result<Child> {
    let binary = std::env::current_exe().context("path of this binary")?;
    let mut command = Command::new(binary);
    command.args(arguments).stdin(Stdio::null()).stdout(Stdio::null()).kill_on_drop(true);
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
        let child = launch(name, &arguments)?;
        self.0.push(Supervised { name: name.to_owned(), arguments, child, restarts: 0 });
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
                match launch(&process.name, &process.arguments) {
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

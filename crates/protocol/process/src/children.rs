//! Processes of a fleet on this machine as children: started in order, started again when one dies, stopped in reverse.

use std::path::PathBuf;
use std::process::Stdio;
use std::time::Duration;

use anyhow::{Context, Result};
use tokio::process::{Child, Command};

/// How often a process that died is started again before the run gives up.
const MAX_RESTARTS: u32 = 8;

/// A command line with what its environment says besides.
#[derive(Debug, Clone, Default)]
pub struct Launch {
    /// The program.
    pub program: PathBuf,
    /// Its arguments.
    pub arguments: Vec<String>,
    /// Names and values of its environment, besides that of this process.
    pub environment: Vec<(&'static str, String)>,
}

#[derive(Debug)]
struct Supervised {
    name: String,
    launch: Launch,
    child: Child,
    restarts: u32,
}

/// Running child processes in order of start. One that dies is started again: its roles are taken over by epoch, its
/// journal goes on from the last commit.
#[derive(Debug, Default)]
pub struct Children(Vec<Supervised>);

fn launch(name: &str, launch: &Launch) -> Result<Child> {
    let mut command = Command::new(&launch.program);
    command.args(&launch.arguments).envs(launch.environment.iter().map(|(key, value)| (key, value)));
    command.stdin(Stdio::null()).stdout(Stdio::null()).kill_on_drop(true);
    let child = command.spawn().with_context(|| format!("start {name}"))?;
    tracing::info!(name, pid = child.id(), "process started");
    Ok(child)
}

impl Children {
    /// Starts a process.
    ///
    /// # Errors
    /// If it cannot be started.
    pub fn add(&mut self, name: &str, way: Launch) -> Result<()> {
        let child = launch(name, &way)?;
        self.0.push(Supervised { name: name.to_owned(), launch: way, child, restarts: 0 });
        Ok(())
    }

    /// Watches the processes and starts dead ones again; returns when one has died too often.
    pub async fn supervise(&mut self) -> anyhow::Error {
        loop {
            for process in &mut self.0 {
                let status = match process.child.try_wait() {
                    Ok(None) => continue,
                    Ok(Some(status)) => status,
                    Err(error) => return anyhow::anyhow!("process {} cannot be watched: {error}", process.name),
                };
                if status.code() == Some(i32::from(crate::service::EXIT_STORAGE)) {
                    let says = format!("process {} cannot write, its own line says why", process.name);
                    return anyhow::Error::new(crate::service::StorageError(says));
                }
                if process.restarts == MAX_RESTARTS || status.code() == Some(i32::from(crate::service::EXIT_USAGE)) {
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
    pub async fn stop(mut self) -> Result<()> {
        while let Some(Supervised { name, mut child, .. }) = self.0.pop() {
            if let Some(pid) = child.id() {
                // The shell's own `kill`: a bare system has no program of that name.
                let killed = Command::new("sh").arg("-c").arg(format!("kill -TERM {pid}")).status().await;
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

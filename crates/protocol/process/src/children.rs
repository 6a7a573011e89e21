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

    /// Returns the id of a process that runs.
    #[must_use]
    pub fn pid(&self, name: &str) -> Option<u32> {
        self.0.iter().find(|process| process.name == name)?.child.id()
    }

    /// Kills one of the copies of a process, the next one each turn; [`Children::supervise`] starts it again, which does not
    /// count as a death.
    ///
    /// # Errors
    /// If there is none, or it cannot be killed.
    pub fn kill(&mut self, kind: &str, turn: usize) -> Result<()> {
        let mut copies: Vec<&mut Supervised> =
            self.0.iter_mut().filter(|process| of_kind(&process.name) == kind).collect();
        let count = copies.len().max(1);
        let copy = copies.get_mut(turn % count).with_context(|| format!("no {kind} runs"))?;
        tracing::info!(name = copy.name, "killed on purpose");
        copy.restarts = copy.restarts.saturating_sub(1);
        copy.child.start_kill().with_context(|| format!("kill {}", copy.name))
    }

    /// Sends SIGTERM to all, the last started first and copies of one process together, and waits for their end.
    ///
    /// # Errors
    /// If a process cannot be signalled or does not end.
    pub async fn stop(mut self) -> Result<()> {
        while let Some(last) = self.0.last() {
            let kind = of_kind(&last.name).to_owned();
            let from = self.0.iter().rposition(|process| of_kind(&process.name) != kind).map_or(0, |before| before + 1);
            let copies = self.0.split_off(from);
            let pids: Vec<String> = copies.iter().filter_map(|copy| Some(copy.child.id()?.to_string())).collect();
            if !pids.is_empty() {
                // The shell's own `kill`: a bare system has no program of that name.
                let killed = Command::new("sh").arg("-c").arg(format!("kill -TERM {}", pids.join(" "))).status().await;
                killed.with_context(|| format!("signal {kind}"))?;
            }
            let until = tokio::time::Instant::now() + Duration::from_secs(10);
            for Supervised { name, mut child, .. } in copies {
                if tokio::time::timeout_at(until, child.wait()).await.is_err() {
                    tracing::warn!(name, "did not drain in 10 s, killed");
                    child.kill().await.with_context(|| format!("kill {name}"))?;
                }
            }
        }
        Ok(())
    }
}

/// Returns the name of a process without the number of its copy.
fn of_kind(name: &str) -> &str {
    name.trim_end_matches(|c: char| c.is_ascii_digit()).trim_end_matches('-')
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sleeper() -> Launch {
        Launch { program: "sleep".into(), arguments: vec!["60".to_owned()], environment: Vec::new() }
    }

    #[tokio::test]
    async fn a_killed_copy_is_started_again_and_all_end_together() {
        let mut children = Children::default();
        for name in ["orchestrator", "worker-0", "worker-1"] {
            children.add(name, sleeper()).expect("it starts");
        }
        let [first, second] = ["worker-0", "worker-1"].map(|name| children.pid(name));
        children.kill("worker", 3).expect("it runs");
        assert!(children.kill("sim", 0).is_err());
        let again = async {
            while children.pid("worker-1") == second || children.pid("worker-1").is_none() {
                let watched = children.supervise();
                drop(tokio::time::timeout(Duration::from_millis(20), watched).await);
            }
        };
        tokio::time::timeout(Duration::from_secs(20), again).await.expect("started again");
        assert_eq!(children.pid("worker-0"), first);
        tokio::time::timeout(Duration::from_secs(20), children.stop()).await.expect("in time").expect("all end");
    }
}

//! The process `viewer`, beside this program: whatever needs rerun is done there.

use std::ffi::OsString;
use std::process::{Command, Stdio};
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use ds_process::beside::{VIEWER, call, program};
use ds_process::onlooker::OnlookerArgs;
use serde::Serialize;
use tokio::io::{AsyncBufReadExt, BufReader};

/// How long the viewer may take to show what it has when the drives are over.
const SHOWN_WITHIN: Duration = Duration::from_secs(10);

/// Runs the viewer to its end on a value, which it reads as JSON.
///
/// # Errors
/// If it is not there or fails; it says itself why.
pub fn hand(words: [OsString; 2], value: &impl Serialize) -> Result<()> {
    let mut child =
        Command::new(program(VIEWER)?).args(words).stdin(Stdio::piped()).spawn().context("start the viewer")?;
    let stdin = child.stdin.take().context("stdin of the viewer")?;
    let handed = serde_json::to_writer(std::io::BufWriter::new(stdin), value);
    let status = child.wait().context("wait for the viewer")?;
    ensure!(status.success(), "the viewer ended with {status}");
    handed.context("hand over to the viewer")
}

/// Returns the word of a window, none for the one of this host.
fn window(url: &str) -> Vec<OsString> {
    if url.is_empty() { Vec::new() } else { vec!["--connect".into(), url.into()] }
}

/// Checks that a window listens.
///
/// # Errors
/// If the viewer is not there, or nothing listens.
pub fn reach(url: &str) -> Result<()> {
    call(VIEWER, std::iter::once("reach".into()).chain(window(url)))
}

/// Returns the words that show drives of a fleet in a window; `which` is the episode and what else is said of it.
pub fn drives(fleet: &OnlookerArgs, url: &str, which: &[&str]) -> Vec<OsString> {
    let words = std::iter::once("drives".into()).chain(which.iter().map(OsString::from));
    words.chain(window(url)).chain(fleet.words()).collect()
}

/// A viewer that looks on while this process lives, and ends with it.
pub struct Onlooker(tokio::process::Child);

impl Onlooker {
    /// Starts one, and returns when it misses nothing more.
    ///
    /// # Errors
    /// If it is not there or cannot look on; it says itself why.
    pub async fn start(words: Vec<OsString>) -> Result<Self> {
        let mut command = tokio::process::Command::new(program(VIEWER)?);
        command.args(words).arg("--attended").stdin(Stdio::piped()).stdout(Stdio::piped()).kill_on_drop(true);
        let mut child = command.spawn().context("start the viewer")?;
        let said = child.stdout.take().context("stdout of the viewer")?;
        let ready = BufReader::new(said).lines().next_line().await.context("hear the viewer")?;
        ensure!(ready.is_some(), "the viewer ended with {}", child.wait().await.context("wait for the viewer")?);
        Ok(Self(child))
    }

    /// Waits until it has shown what was said.
    ///
    /// # Errors
    /// If it fails or hangs.
    pub async fn finish(mut self) -> Result<()> {
        drop(self.0.stdin.take());
        let status = tokio::time::timeout(SHOWN_WITHIN, self.0.wait()).await.context("the viewer hangs")?;
        let status = status.context("wait for the viewer")?;
        ensure!(status.success(), "the viewer ended with {status}");
        Ok(())
    }
}

//! The programs that lie beside this one and do what it does not link: `viewer` (rerun) and `trainer`.

use std::ffi::OsString;
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, ensure};

/// The process that shows drives, diagnoses and trainings.
pub const VIEWER: &str = "viewer";
/// The process that renders clips, trains, and measures what was trained.
pub const TRAINER: &str = "trainer";

/// Returns a program.
///
/// # Errors
/// If it is not there; the text says how to build it.
pub fn program(name: &str) -> Result<PathBuf> {
    let file = format!("{name}{}", std::env::consts::EXE_SUFFIX);
    let beside = std::env::current_exe().context("path of this binary")?.with_file_name(file);
    ensure!(
        beside.is_file(),
        "the {name} is a program of its own and not at {}: `cargo build --locked -p dreamstream -p {name}` builds it there",
        beside.display()
    );
    Ok(beside)
}

/// Runs a program to its end.
///
/// # Errors
/// If it is not there or fails; it says itself why.
pub fn call(name: &str, words: impl IntoIterator<Item = OsString>) -> Result<()> {
    let status = Command::new(program(name)?).args(words).status().with_context(|| format!("start the {name}"))?;
    ensure!(status.success(), "the {name} ended with {status}");
    Ok(())
}

/// Becomes a program, whose signals and exit code are its own; returns only if it is not there or cannot be started.
#[must_use]
pub fn replaced_by(name: &str, words: impl IntoIterator<Item = OsString>) -> anyhow::Error {
    let started = program(name).map(|path| Command::new(path).args(words).exec());
    started.map_or_else(|error| error, |error| anyhow::Error::new(error).context(format!("start the {name}")))
}

//! Checks the logs of a mapping file, prints what looks wrong, and writes the case folder that the diagnosis takes.
//!
//! `cargo run -p ds-gap --example logs -- MAPPING LOGS_DIR [--out CASE_DIR]`
#![allow(clippy::print_stdout, reason = "the findings are this example's answer")]

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use ds_gap::logs::{LogError, Mapping};

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let out = arguments.iter().position(|a| a == "--out").and_then(|k| arguments.get(k + 1)).map(PathBuf::from);
    let [mapping, logs, ..] = arguments.as_slice() else {
        println!("usage: logs MAPPING LOGS_DIR [--out CASE_DIR]");
        return ExitCode::from(64);
    };
    match run(Path::new(mapping), Path::new(logs), out.as_deref()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let source = std::error::Error::source(&error).map(|s| format!(": {s}")).unwrap_or_default();
            println!("{error}{source}");
            ExitCode::FAILURE
        }
    }
}

fn run(mapping: &Path, logs: &Path, out: Option<&Path>) -> Result<(), LogError> {
    let mapping = Mapping::read(mapping)?;
    let found = mapping.check(logs)?;
    for finding in &found {
        println!("{finding}");
    }
    println!("{} findings", found.len());
    let Some(out) = out else { return Ok(()) };
    for (k, drive) in mapping.case(logs, out)?.iter().enumerate() {
        println!("drive {k}: {} from {:.1} s, {:.1} s long", drive.file, drive.start_secs, drive.secs());
    }
    Ok(())
}

//! Trains or measures the camera policy: `train-policy run SETTINGS FOLDER` or `train-policy evaluate SETTINGS WEIGHTS`.
//!
//! A thin main over [`ds_train::policy`] for long runs in the background; lines of JSON go to standard error.

use std::error::Error;
use std::path::Path;
use std::process::ExitCode;

use ds_train::policy::{PolicySettings, evaluate, run};

fn work(arguments: &[String]) -> Result<(), Box<dyn Error>> {
    let [command, settings, path] = arguments else {
        return Err("usage: train-policy run SETTINGS FOLDER | train-policy evaluate SETTINGS WEIGHTS".into());
    };
    let settings = PolicySettings::parse(&std::fs::read_to_string(settings)?)?;
    let mut listener = |line: &str| eprintln!("{line}");
    match command.as_str() {
        "run" => run(&settings, Path::new(path), &mut listener).map(|_| ())?,
        "evaluate" => evaluate(&settings, Path::new(path), &mut listener).map(|_| ())?,
        other => return Err(format!("unknown command {other:?}, known are \"run\", \"evaluate\"").into()),
    }
    Ok(())
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Err(error) = work(&arguments) else { return ExitCode::SUCCESS };
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(error) = source {
        text = format!("{text}: {error}");
        source = error.source();
    }
    eprintln!("{text}");
    ExitCode::FAILURE
}

//! Runs one training stage: `train-video CONFIG clips|autoencoder|teacher|student|decoder|ship|evaluate`, with a line now and then.

use std::path::Path;
use std::process::ExitCode;

use ds_train::{Progress, TrainConfig, TrainError};

struct Lines;

impl Progress for Lines {
    fn step(&mut self, step: u32, total: u32, loss: f32, figures: &[(&str, f32)]) {
        if step.is_multiple_of(10) || step <= 3 {
            let figures: Vec<String> = figures.iter().map(|(name, value)| format!("{name} {value:.4}")).collect();
            eprintln!("step {step}/{total} loss {loss:.5} {}", figures.join(" "));
        }
    }

    fn note(&mut self, text: &str) {
        eprintln!("{text}");
    }
}

fn run(config: &Path, stage: &str) -> Result<(), TrainError> {
    let config = TrainConfig::load(config)?;
    let report = match stage {
        "clips" => return ds_train::reference::render(&config, &mut Lines),
        "autoencoder" => ds_train::autoencoder::run(&config, &mut Lines)?,
        "teacher" => ds_train::teacher::run(&config, &mut Lines)?,
        "student" => ds_train::student::run(&config, &mut Lines)?,
        "evaluate" => {
            let figures = ds_train::evaluate::long(&config, &mut Lines)?;
            figures.iter().for_each(|(name, value)| eprintln!("{name} {value:.3}"));
            return Ok(());
        }
        "decoder" => ds_train::decoder::run(&config, &mut Lines)?,
        "ship" => return ds_train::ship::run(&config, &mut Lines),
        other => {
            return Err(TrainError::Config { field: "stage", rule: format!("there is no stage {other:?}") });
        }
    };
    eprintln!("{report:?}");
    Ok(())
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [config, stage] = arguments.as_slice() else {
        eprintln!("usage: train-video CONFIG clips|autoencoder|teacher|student|decoder|ship|evaluate");
        return ExitCode::from(64);
    };
    match run(Path::new(config), stage) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            let mut source = std::error::Error::source(&error);
            while let Some(error) = source {
                eprintln!("  {error}");
                source = error.source();
            }
            ExitCode::FAILURE
        }
    }
}

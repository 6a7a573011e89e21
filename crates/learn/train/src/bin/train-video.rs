//! Runs stages of a training: `train-video CONFIG STAGE...`, with a line now and then. Without the command line's
//! weight, for long trainings beside other work.

use std::path::Path;
use std::process::ExitCode;

use ds_train::{Progress, Stage, TrainConfig, TrainError};

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

fn run(config: &Path, stages: &[String]) -> Result<(), TrainError> {
    let config = TrainConfig::load(config)?;
    for name in stages {
        let stage = Stage::ALL.into_iter().find(|stage| stage.name() == name);
        let rule = format!("there is no stage {name:?}");
        let stage = stage.ok_or(TrainError::Config { field: "stage", rule })?;
        eprintln!("{name}");
        if let Some(report) = stage.run(&config, &mut Lines)? {
            eprintln!("{report:?}");
        }
    }
    Ok(())
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let Some((config, stages)) = arguments.split_first().filter(|(_, stages)| !stages.is_empty()) else {
        let stages: Vec<&str> = Stage::ALL.iter().map(|stage| stage.name()).collect();
        eprintln!("usage: train-video CONFIG STAGE..., stages {}", stages.join(", "));
        return ExitCode::from(64);
    };
    match run(Path::new(config), stages) {
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

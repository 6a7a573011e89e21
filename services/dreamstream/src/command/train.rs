//! `train`: one stage of training, resumable; the same functions as the training binaries.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result};
use ds_train::policy::PolicySettings;
use ds_train::{Progress, TrainConfig};
use indicatif::ProgressBar;

use crate::cli::TrainArgs;
use crate::command::{answer, bar};

const VIDEO_CONFIG: &str = "configs/train/cpu_train.toml";
const POLICY_CONFIG: &str = "configs/train/policy.toml";

struct Bar {
    bar: ProgressBar,
    stop: Arc<AtomicBool>,
}

impl Progress for Bar {
    fn step(&mut self, step: u32, total: u32, loss: f32, _figures: &[(&str, f32)]) {
        self.bar.set_length(u64::from(total));
        self.bar.set_position(u64::from(step));
        self.bar.set_message(format!("loss {loss:.5}"));
    }

    fn note(&mut self, text: &str) {
        self.bar.println(text);
    }

    fn stop(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// Runs a stage until its last step; Ctrl-C stores a checkpoint from which the same command goes on.
///
/// # Errors
/// If the configuration is refused or files cannot be written.
pub(crate) fn run(args: &TrainArgs) -> Result<()> {
    if args.stage == "policy" {
        return policy(args);
    }
    let path = args.config.clone().unwrap_or_else(|| PathBuf::from(VIDEO_CONFIG));
    let config = TrainConfig::load(&path).with_context(|| format!("configuration {}", path.display()))?;
    let mut progress = Bar { bar: bar(0, "steps"), stop: stop_flag()? };
    let report = match args.stage.as_str() {
        "clips" => {
            ds_train::reference::render(&config, &mut progress)?;
            None
        }
        "autoencoder" => Some(ds_train::autoencoder::run(&config, &mut progress)?),
        "teacher" => Some(ds_train::teacher::run(&config, &mut progress)?),
        "student" => Some(ds_train::student::run(&config, &mut progress)?),
        "decoder" => Some(ds_train::decoder::run(&config, &mut progress)?),
        _ => {
            ds_train::ship::run(&config, &mut progress)?;
            None
        }
    };
    progress.bar.finish_and_clear();
    if let Some(report) = report {
        answer(&format!("{} steps, loss {:.5}, weights {}", report.steps, report.loss, report.weights.display()));
        report.figures.iter().for_each(|(name, value)| answer(&format!("  {name} {value:.4}")));
    }
    Ok(())
}

fn policy(args: &TrainArgs) -> Result<()> {
    let path = args.config.clone().unwrap_or_else(|| PathBuf::from(POLICY_CONFIG));
    let text = std::fs::read_to_string(&path).with_context(|| format!("configuration {}", path.display()))?;
    let settings = PolicySettings::parse(&text).with_context(|| format!("configuration {}", path.display()))?;
    let spinner = ProgressBar::new_spinner();
    ds_train::policy::run(&settings, Path::new(&args.out), &mut |line: &str| {
        spinner.set_message(line.to_owned());
        spinner.tick();
    })?;
    spinner.finish_and_clear();
    answer(&format!("policy trained; checkpoints in {}", args.out.display()));
    Ok(())
}

/// Returns a flag that SIGINT raises.
fn stop_flag() -> Result<Arc<AtomicBool>> {
    let flag = Arc::new(AtomicBool::new(false));
    let raised = Arc::clone(&flag);
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    std::thread::Builder::new().name("signals".to_owned()).spawn(move || {
        if runtime.block_on(tokio::signal::ctrl_c()).is_ok() {
            raised.store(true, Ordering::Relaxed);
        }
    })?;
    Ok(flag)
}

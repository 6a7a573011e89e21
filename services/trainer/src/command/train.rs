//! `train`: one stage of training, resumable.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use ds_launch::{Networks, onlooker as viewer};
use ds_process::service::InterruptedError;
use ds_process::shipped;
use ds_process::terminal::{answer, bar, stop_flag};
use ds_record::viewing::{TrainedStage, Training};
use ds_train::policy::PolicySettings;
use ds_train::{Progress, Stage, TrainConfig};
use ds_video::Backend;
use indicatif::ProgressBar;

use crate::cli::TrainArgs;

const VIDEO_CONFIG: &str = "configs/train/cpu_train.toml";
const POLICY_CONFIG: &str = "configs/train/policy.toml";

struct Bar {
    bar: ProgressBar,
    stop: Arc<AtomicBool>,
    /// When the first update of this run was made and which it was, and the last one: a device prepares itself in the first.
    made: Option<[(Instant, u32); 2]>,
}

impl Bar {
    fn new(what: &'static str, stop: Arc<AtomicBool>) -> Self {
        Self { bar: bar(0, what), stop, made: None }
    }

    /// Says how fast the updates after the first were made, in operations as [`ds_train::cost`] counts them.
    fn rate(&self, operations: f64) -> Option<String> {
        let [(began, first), (ended, last)] = self.made?;
        let (updates, seconds) = (f64::from(last - first), (ended - began).as_secs_f64());
        let rate = updates * operations / seconds;
        (updates > 0.0 && seconds > 0.0)
            .then(|| format!("  {updates} updates after the first in {seconds:.1} s, {:.3} TFLOP/s", rate * 1e-12))
    }
}

impl Progress for Bar {
    fn step(&mut self, step: u32, total: u32, loss: f32, _figures: &[(&str, f32)]) {
        let now = (Instant::now(), step);
        self.made = Some([self.made.map_or(now, |[first, _]| first), now]);
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

/// Prints what each stage costs and how far it is.
fn plan(config: &TrainConfig) -> Result<()> {
    answer(&format!("{:<14} {:>8} {:>12} {:>10} {:>8}", "stage", "updates", "GFLOP each", "TFLOP", "done"));
    let mut total = [0.0; 2];
    for cost in ds_train::cost::costs(config)? {
        #[expect(clippy::cast_precision_loss, reason = "figures for people")]
        let (all, done) = (cost.updates as f64 * cost.operations, cost.done as f64 * cost.operations);
        total = [total[0] + all, total[1] + done];
        let (each, all) = (cost.operations * 1e-9, all * 1e-12);
        answer(&format!("{:<14} {:>8} {each:>12.2} {all:>10.2} {:>8}", cost.stage, cost.updates, cost.done));
    }
    answer(&format!("planned {:.1} TFLOP, of which {:.1} are logged as done", total[0] * 1e-12, total[1] * 1e-12));
    Ok(())
}

/// Runs a stage, or all that the recipe describes, until its last step; Ctrl-C stores a checkpoint from which the same
/// command goes on.
///
/// # Errors
/// If the configuration is refused or files cannot be written.
pub(crate) fn run(args: &TrainArgs) -> Result<()> {
    if args.stage == "policy" {
        return policy(args);
    }
    let path = args.config.clone().unwrap_or_else(|| shipped::find(Path::new(VIDEO_CONFIG)));
    let mut config = TrainConfig::load(&path).with_context(|| format!("configuration {}", path.display()))?;
    if let Some(backend) = args.backend {
        config.backend = backend;
    }
    if args.stage == "plan" {
        return plan(&config);
    }
    if args.stage == "unpack" {
        let (Some(of), Some(weights)) = (&args.of, &args.weights) else {
            bail!("unpack needs --of STAGE and --weights FILE")
        };
        let mut progress = Bar::new("unpack", stop_flag()?);
        return Ok(ds_train::ship::unpack(&config, of, weights, &mut progress)?);
    }
    let stop = stop_flag()?;
    let named = |stage: &Stage| args.stage == stage.name();
    let whole = |stage: &Stage| args.stage == "all" && stage.described(&config);
    for stage in Stage::ALL.into_iter().filter(|stage| named(stage) || whole(stage)) {
        let mut progress = Bar::new(stage.name(), Arc::clone(&stop));
        let report = if stage == Stage::Ship {
            let (of, out) = (args.of.as_deref(), args.weights.as_deref());
            ds_train::ship::run(&config, of, out, &mut progress).map(|()| None)
        } else {
            stage.run(&config, &mut progress)
        };
        progress.bar.finish_and_clear();
        if let Some(report) = report.with_context(|| format!("stage {}", stage.name()))? {
            let (steps, loss, weights) = (report.steps, report.loss, report.weights.display());
            answer(&format!("{}: {steps} steps, loss {loss:.5}, weights {weights}", stage.name()));
            report.figures.iter().for_each(|(name, value)| answer(&format!("  {name} {value:.4}")));
        }
        let costs = ds_train::cost::costs(&config)?;
        let cost = costs.iter().find(|cost| cost.stage == stage.name().replace('-', "_"));
        if let Some(rate) = cost.and_then(|cost| progress.rate(cost.operations)) {
            answer(&rate);
        }
        let page = ds_train::page::write(&config)?;
        answer(&format!("losses and samples: {}", page.display()));
        if args.rerun {
            answer(&format!("in the viewer: rerun {}", view(&config)?.display()));
        }
        if stop.load(Ordering::Relaxed) {
            return Err(InterruptedError("the same command goes on from here".to_owned()).into());
        }
    }
    Ok(())
}

/// Writes `training.rrd` beside the page.
fn view(config: &TrainConfig) -> Result<PathBuf> {
    let path = config.folder.join("training.rrd");
    let stages = ds_train::page::stages(config).into_iter().map(|(name, curves, sheet)| TrainedStage {
        name: name.to_owned(),
        curves: curves.into_iter().map(|curve| (curve.name, curve.points)).collect(),
        sheet: sheet.filter(|path| path.is_file()),
    });
    let stages = stages.collect();
    let name = config.folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    viewer::hand(["training".into(), (&path).into()], &Training { name, stages })?;
    Ok(path)
}

fn policy(args: &TrainArgs) -> Result<()> {
    let backend = args.backend.unwrap_or(Backend::Framework);
    backend.ready()?;
    let path = args.config.clone().unwrap_or_else(|| shipped::find(Path::new(POLICY_CONFIG)));
    let text = std::fs::read_to_string(&path).with_context(|| format!("configuration {}", path.display()))?;
    let settings = PolicySettings::parse(&text).with_context(|| format!("configuration {}", path.display()))?;
    if let Some(weights) = &args.weights {
        ds_train::policy::evaluate(args.kind, &settings, weights, &mut answer)
            .with_context(|| format!("weights {}", weights.display()))?;
        return Ok(());
    }
    let shipped = args.kind.begins_with().unwrap_or(args.kind).weights_file(&Networks::default().policy_weights);
    let spinner = ProgressBar::new_spinner();
    ds_train::policy::run(args.kind, &settings, backend, [&args.out, &shipped], &mut |line: &str| {
        spinner.set_message(line.to_owned());
        spinner.tick();
    })?;
    spinner.finish_and_clear();
    answer(&format!("policy trained; checkpoints in {}", args.out.display()));
    Ok(())
}

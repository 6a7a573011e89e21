//! `gap next`: designs the run that would tell most of what a diagnosis leaves open, and with `--run` drives it in a simulator
//! that stands for reality.

use std::fmt::Write as _;
use std::path::{Component, Path};
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use ds_cases::case::{Case, served};
use ds_cases::folder::{folders, names};
use ds_cases::{CasesError, RunConfig, baseline};
use ds_diagnosis::json;
use ds_diagnosis::meta::{DriveEntry, Split};
use ds_diagnosis::table::Table;
use ds_dynamics::baseline::Baseline;
use ds_dynamics::ego::FINE_SECS;
use ds_dynamics::motion::{BuiltIn, Motion};
use ds_dynamics::space::{Part, Space};
use ds_dynamics::{Options, diagnose_leaving};
use ds_effect::{Plant, Setting};
use ds_experiment::{Design, Envelope, Next, Run, Settings, World};
use ds_process::service::UsageError;
use ds_process::terminal::{answer, complain};
use ds_simulator::Reality;

use crate::cli::NextArgs;
use crate::{put, tables};

/// Seconds between rows of the commands.
const COMMAND_STEPS: usize = 5;

/// Runs the command.
///
/// # Errors
/// If a case or the envelope is refused, no manoeuvre holds it, or a file cannot be read or written.
pub(crate) fn run(args: &NextArgs) -> Result<()> {
    let envelope = args.envelope.as_deref().map(envelope).transpose()?.unwrap_or_default();
    envelope.check().map_err(|error| UsageError(error.to_string()))?;
    let known = args.baseline.as_deref().map(|path| baseline::open(path, None)).transpose()?;
    let settings = Settings { seed: args.seed, envelope, quick: args.quick, without: Vec::new() };
    let made = folders(&args.cases)?.iter().map(|case| tables(case, None, &args.out)).collect::<Result<Vec<_>>>()?;
    let cases = made.concat();
    for (path, name) in cases.iter().zip(names(&cases)) {
        one(args, path, &args.out.join(&name), known.as_ref(), &settings).with_context(|| name.clone())?;
    }
    answer(&format!("written to {}", args.out.display()));
    Ok(())
}

fn envelope(path: &Path) -> Result<Envelope> {
    let text = std::fs::read_to_string(path).with_context(|| format!("read {}", path.display()))?;
    toml::from_str(&text).map_err(|error| UsageError(format!("{} is no envelope: {error}", path.display())).into())
}

fn one(args: &NextArgs, path: &Path, out: &Path, known: Option<&Arc<Baseline>>, settings: &Settings) -> Result<()> {
    let Case::Vehicle(case, _) = Case::read(path)?.against(known)? else {
        return Err(CasesError::NoVehicle { path: path.to_path_buf() }.into());
    };
    let next = if args.run {
        let plant = reality(args, &case)?;
        let command = args.simulator.as_ref().map(|command| served(command, path));
        let reality = command.map(|command| Reality::start(&command, &case.meta.nominal)).transpose()?;
        let motion: &dyn Motion = reality.as_ref().map_or(&BuiltIn, |reality| reality);
        let driven = ds_experiment::run(&case, &World { motion, plant: &plant }, settings, &told);
        let (next, logs, diagnosis) = driven.map_err(|error| match reality.as_ref().and_then(Reality::failure) {
            Some(why) => anyhow::Error::from(error).context(why.to_string()),
            None => error.into(),
        })?;
        // The loop kept what earlier runs gave.
        if let Some(why) = reality.as_ref().and_then(Reality::failure) {
            complain(&why.into());
        }
        grow(path, &case, &next, &logs, &out.join("case"))?;
        diagnosis.write(out)?;
        next
    } else {
        let options = Options { quick: args.quick, without: Vec::new() };
        let (diagnosis, standings) = diagnose_leaving(&case, &options);
        ds_experiment::choose(&case, &diagnosis, &standings, settings)?
    };
    json::write(&next, &out.join("next.json"))?;
    put(&out.join("next.html"), &ds_diagnosis_page::experiment(&next))?;
    if let Some(planned) = next.planned.as_ref().filter(|_| next.ended.is_none()) {
        put(&out.join("commands.csv"), &commands(&Design::named(&planned.design), &case))?;
    }
    answer(&ds_diagnosis_page::experiment_text(&next));
    Ok(())
}

fn told(run: &Run) {
    let found = if run.effects.is_empty() { "ordinary mismatch".to_owned() } else { run.effects.join(" + ") };
    answer(&format!("run {}: {}, then {found} with probability {:.3}", run.run, run.from, run.probability));
}

/// Returns the car that stands for reality.
fn reality(args: &NextArgs, case: &ds_dynamics::case::Case) -> Result<Plant> {
    let config = RunConfig::gather(args.config.as_ref(), &args.effect, &[])?;
    let space = Space::new(Part::Ego, &case.meta.nominal, &[]);
    let usual = args.config.is_none() && !case.meta.simulated;
    let mut plant = space.plant(&if usual { space.usual() } else { space.neutral() });
    let lines = config.lines().map(|line| (line.id.as_str(), line.values.as_slice()));
    for (id, values) in lines.chain(config.laws.iter().map(|law| (law.as_str(), &[][..]))) {
        Setting::new(id, values).map_err(|error| CasesError::Effect(error.to_string()))?.apply(&mut plant);
    }
    Ok(plant)
}

/// Writes the case with the logs of the runs beside those that it had.
fn grow(from: &Path, case: &ds_dynamics::case::Case, next: &Next, logs: &[Table], out: &Path) -> Result<()> {
    std::fs::create_dir_all(out).with_context(|| format!("make {}", out.display()))?;
    let mut meta = case.meta.clone();
    let files = meta.drives.iter().flat_map(|drive| std::iter::once(&drive.file).chain(&drive.agents));
    for file in files {
        let inside = Path::new(file).components().all(|part| matches!(part, Component::Normal(_)));
        ensure!(inside, "{file:?} lies outside the case, which cannot be copied");
        let to = out.join(file);
        to.parent().map(std::fs::create_dir_all).transpose()?;
        std::fs::copy(from.join(file), &to).with_context(|| format!("copy {file} to {}", out.display()))?;
    }
    let (mut fit, held_out) = meta.split();
    for (run, log) in next.runs.iter().zip(logs) {
        fit.push(meta.drives.len());
        meta.drives.push(DriveEntry { file: run.file.clone(), ..DriveEntry::default() });
        put(&out.join(&run.file), &log.to_csv())?;
    }
    meta.suggested_split = Some(Split { fit, held_out });
    Ok(meta.write(out)?)
}

/// Returns the commands of a manoeuvre for whoever drives it.
fn commands(design: &Design, case: &ds_dynamics::case::Case) -> String {
    let inputs = design.inputs(&case.meta.nominal);
    let mut text = String::from("t,cmd_steer,cmd_accel,planned_v\n");
    for k in (0..inputs.steer.len()).step_by(COMMAND_STEPS) {
        let (steer, accel, speed) = (inputs.steer[k], inputs.accel[k], inputs.speed[k]);
        let _infallible = writeln!(text, "{:.2},{steer:.5},{accel:.4},{speed:.3}", k as f64 * FINE_SECS);
    }
    text
}

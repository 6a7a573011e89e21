//! `study`: tables over held-out scenarios, with a bar of what is done.

mod closed_loop;
mod drives;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Result;
use clap::Subcommand;
use ds_evaluate::EvaluationError;
use ds_evaluate::study::config::Recorded;
use ds_evaluate::study::outcome::{Figure, Outcome, Parts, PlansOf, Table};
use ds_evaluate::study::{self, Guests, Means, Study, StudyConfig};
use ds_launch::guest;
use ds_policy::Policy;
use ds_process::run_folder::{self, Earlier, Held};
use ds_process::service::UsageError;
use ds_process::shipped;
use ds_process::terminal::{answer, bar};

use crate::cli::{GivenArgs, StudyArgs, StudyCommand};
use crate::command::video::Bar;

/// Runs a command of `study`.
///
/// # Errors
/// If a file cannot be used or frames cannot be made.
pub(crate) fn run(command: &StudyCommand) -> Result<()> {
    match command {
        StudyCommand::Fidelity(args) => of_frames(Study::Fidelity, args),
        StudyCommand::Correlation(args) => of_frames(Study::Correlation, args),
        StudyCommand::Sensitivity(args) => of_frames(Study::Sensitivity, args),
        StudyCommand::Rollout(args) => of_frames(Study::Rollout, args),
        StudyCommand::Ablation(args) => of_frames(Study::Ablation, args),
        StudyCommand::Anchor(args) => of_frames(Study::Anchor, args),
        StudyCommand::Parts(args) => of_frames(Study::Parts, args),
        StudyCommand::Drives(args) => drives::run(args),
        StudyCommand::ClosedLoop(args) => closed_loop::run(args),
    }
}

/// Returns what lets policies of other processes connect.
fn guests() -> Result<Box<Guests<'static>>> {
    // Until the process ends: a thread may still wait for a policy that does not answer.
    let runtime = &*Box::leak(Box::new(ds_launch::runtime()?));
    Ok(Box::new(move |name: &str, listen: &str| {
        let guest = guest::connecting(runtime, name, listen).map_err(|error| format!("{error:#}"))?;
        Ok(Box::new(guest) as Box<dyn Policy>)
    }))
}

/// Returns the configuration that is meant.
fn config_of(args: &StudyArgs, name: &str) -> PathBuf {
    args.config.clone().unwrap_or_else(|| shipped::find(Path::new(&format!("configs/study/{name}.toml"))))
}

/// Reads a configuration.
///
/// # Errors
/// [`UsageError`] names the file and what is wrong with it.
fn load(path: &Path) -> Result<StudyConfig> {
    Ok(StudyConfig::load(path).map_err(|error| wrong(path, error))?)
}

/// Says what is wrong with a file of settings.
fn wrong(path: &Path, error: impl Into<anyhow::Error>) -> UsageError {
    UsageError(format!("{}: {:#}", path.display(), error.into()))
}

/// Returns a refusal of settings as one, and what failed otherwise as it is.
fn refused(path: &Path, error: EvaluationError) -> anyhow::Error {
    if matches!(error, EvaluationError::Config { .. }) { wrong(path, error).into() } else { error.into() }
}

/// Takes hold of the folder of a study of a name.
///
/// # Errors
/// If another run holds it, or [`UsageError`] if it holds what another study found.
fn take(out: &Path, name: &str) -> Result<Held> {
    let held = run_folder::take(out, Earlier::Resumed)?;
    let all = StudyCommand::augment_subcommands(clap::Command::new("study"));
    for other in all.get_subcommands().map(clap::Command::get_name).filter(|other| *other != name) {
        let found = out.join(format!("{other}.json"));
        if found.exists() {
            let says = format!("{} is of study {other}, a folder holds one study: give another --out", found.display());
            return Err(UsageError(says).into());
        }
    }
    Ok(held)
}

/// Names the networks of the command line in place of the configuration's.
fn give(config: &mut StudyConfig, args: &GivenArgs) -> Result<()> {
    for (manifest, given) in [(&mut config.fid, &args.fid), (&mut config.fvd, &args.fvd)] {
        if let Some(file) = given {
            *manifest = Some(std::path::absolute(file)?);
        }
    }
    Ok(())
}

fn of_frames(study: Study, args: &StudyArgs) -> Result<()> {
    let path = config_of(args, study.name());
    let mut config = load(&path)?;
    if let Some(out) = &args.out {
        config.out.clone_from(out);
    }
    if args.quick {
        config = config.quick();
    }
    config.scenarios = args.scenarios.unwrap_or(config.scenarios);
    if let Some(file) = &args.recorded {
        config.recorded = Recorded::load(file).map_err(|error| wrong(file, error))?;
    }
    give(&mut config, &args.given)?;
    config.check_for(study).map_err(|error| refused(&path, error))?;
    let _held = take(&config.out, study.name())?;
    let began = Instant::now();
    let mut progress = Bar(bar(0, "sets"));
    let means = Means { guests: &guests()?, seconds: &|| began.elapsed().as_secs_f64(), workers: None };
    let mut outcome = study::run(study, &config, &means, &mut progress).map_err(|error| refused(&path, error))?;
    outcome.quick = args.quick;
    study::write(&config, &outcome)?;
    progress.0.finish_and_clear();
    match &outcome.parts {
        Some(found) => parts(&outcome, found),
        None => said(&outcome),
    }
    findings(&outcome);
    for name in [format!("{}.json", study.name()), "index.html".to_owned()] {
        answer(&config.out.join(name).display().to_string());
    }
    Ok(())
}

/// A value with its interval.
fn shown(figure: Figure) -> String {
    format!("{:.2} [{:.2}, {:.2}]", figure.value, figure.low, figure.high)
}

fn findings(outcome: &Outcome) {
    for (name, metric) in outcome.correlation.iter().flat_map(|found| &found.metrics) {
        answer(&format!("r of PDMS with {name}: {}, Spearman {:.2}", shown(metric.r), metric.spearman));
    }
    for response in outcome.sensitivity.iter().flat_map(|found| &found.responses) {
        for (name, found) in &response.answers {
            let times = found.times.map_or_else(String::new, |times| format!("; FDpi answers {} times", shown(times)));
            answer(&format!(
                "{} against {}, {name}: {}{times}",
                response.after,
                response.before,
                shown(found.response)
            ));
        }
    }
    for hard in outcome.sensitivity.iter().flat_map(|found| &found.hard) {
        answer(&format!("hard scenarios, {}: {:+.0} %, p {:.3}", hard.source, 100.0 * hard.more, hard.p));
    }
    for curve in outcome.rollout.iter().flat_map(|found| &found.curves) {
        answer(&format!("rise of {}: {}", curve.source, shown(curve.rise)));
    }
    for removed in outcome.rollout.iter().flat_map(|found| &found.removed) {
        let share = removed.share.map_or_else(|| "none".to_owned(), shown);
        answer(&format!("share of the rise of {} that {} takes away: {share}", removed.without, removed.with));
    }
}

/// Says of each source and policy how far plans are apart, and what each part does to that.
fn parts(outcome: &Outcome, found: &Parts) {
    answer(&format!("metres after 2 s, 95 % intervals over {}; {}", outcome.of_scenarios(), outcome.kind));
    let policies = |(source, policies)| std::iter::repeat(source).zip(policies);
    let all: Vec<(&String, (&String, &PlansOf))> = found.sources.iter().flat_map(policies).collect();
    for (source, (policy, plans)) in all {
        let Figure { value, low, high } = plans.ahead_m;
        answer(&format!(
            "{policy} on {source}: {} m apart, {value:+.2} [{low:+.2}, {high:+.2}] m further ahead, {} moments",
            shown(plans.apart_m),
            plans.moments
        ));
        answer(&format!("  {:<22}{:>21}{:>21}{:>10}", "part", "taken away, m", "alone, m", "pixels"));
        for part in &plans.parts {
            answer(&format!(
                "  {:<22}{:>21}{:>21}{:>8.2} %",
                part.part,
                shown(part.taken_away_m),
                shown(part.alone_m),
                100.0 * part.share.value
            ));
        }
    }
}

/// Says the distances of some networks.
fn tables<'a>(tables: impl IntoIterator<Item = (&'a String, &'a Table)>) {
    for (name, table) in tables {
        for (source, row) in &table.sources {
            let warnings: String = row.warnings.iter().map(|warning| format!("; {warning}")).collect();
            let (figure, bias) = (shown(row.fd), row.bias);
            answer(&format!("  {name} {source}: {figure}, bias of independent sets {bias:.2}{warnings}"));
        }
    }
}

fn said(outcome: &Outcome) {
    answer(&format!("× 100, 95 % intervals over {}; {}", outcome.of_scenarios(), outcome.kind));
    if let Some(anchor) = &outcome.anchor {
        let [first, second] = &anchor.unit;
        let says = |table: &BTreeMap<String, f64>| {
            table.iter().map(|(name, value)| format!("{name} {value:.2}")).collect::<Vec<_>>().join(", ")
        };
        answer(&format!("in units of {first} to {second}, from {first}: {}", says(&anchor.recorded_to)));
        answer(&format!("in units of {first} to {second}, from the study's real set: {}", says(&anchor.reference_to)));
    }
    for (name, figure) in &outcome.fd_pi {
        answer(&format!("FDpi {name}: {:.2} [{:.2}, {:.2}]", figure.value, figure.low, figure.high));
    }
    tables(outcome.policies.iter().chain(&outcome.others));
    if !outcome.given.is_empty() {
        answer("by the networks given, in their features' own unit, not × 100:");
        tables(&outcome.given);
    }
    for ratio in &outcome.ratios {
        let text = ratio.ratio.map_or_else(
            || "none, a value is not above zero".to_owned(),
            |r| format!("{:.2} [{:.2}, {:.2}]", r.value, r.low, r.high),
        );
        answer(&format!("{} / {}: {text}", ratio.above, ratio.below));
    }
}

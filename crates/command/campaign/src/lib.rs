//! A campaign: sets of scenarios built and reviewed, the cells of a benchmark driven on any number of machines, one result, its
//! report; and what the exit code says.

mod above;
pub mod adverse;
mod ask;
mod behavior;
mod build;
pub mod cli;
mod drive;
mod ended;
mod falls;
mod overall;
mod plan;
mod quality;
mod review;
mod scale;
mod shown;
mod tables;

use std::process::ExitCode;

use anyhow::Result;
use ds_benchmark::{Manifest, Merged};
use ds_process::drain::EXIT_INTERRUPTED;
use ds_process::terminal::{answer, complain};

use cli::{BenchmarkArgs, BenchmarkCommand, RunArgs};

/// Exit code where cells are left that another try may drive.
const LEFT: u8 = 1;
/// Exit code where trying again helps nothing.
const REFUSED: u8 = 2;

/// How a command ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Ended {
    /// Nothing is left to do.
    Complete,
    /// Cells were aborted or are missing.
    Left,
    /// A signal came.
    Interrupted,
}

/// A service of the fleet ended though nobody asked it to; another try may go well.
#[derive(Debug)]
struct FleetLost;

impl std::fmt::Display for FleetLost {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("a service ended early; `benchmark resume` goes on")
    }
}

/// Runs the command and returns its exit code.
pub fn run(args: &BenchmarkArgs, log: &str) -> ExitCode {
    match ds_process::logging::start(log).and_then(|()| dispatch(&args.command, log)) {
        Ok(Ended::Complete) => ExitCode::SUCCESS,
        Ok(Ended::Left) => ExitCode::from(LEFT),
        Ok(Ended::Interrupted) => ExitCode::from(EXIT_INTERRUPTED),
        Err(error) => {
            complain(&error);
            let storage = ds_process::service::exit_code(&error) == ds_process::service::EXIT_STORAGE;
            let again = error.is::<FleetLost>() && !storage;
            ExitCode::from(if again { LEFT } else { REFUSED })
        }
    }
}

/// Drives every so many-th entry of each set of a benchmark, or goes on with them; says whether all of it is done.
///
/// # Errors
/// If anything is refused, the folder holds other cells, or the fleet is lost.
pub fn drives(args: &RunArgs, every: usize) -> Result<bool> {
    Ok(drive::part(args, every)? == Ended::Complete)
}

fn dispatch(command: &BenchmarkCommand, log: &str) -> Result<Ended> {
    match command {
        BenchmarkCommand::Build(command) => build::run(command),
        BenchmarkCommand::Check { manifests } => build::check(manifests),
        BenchmarkCommand::Review(args) => review::run(args),
        BenchmarkCommand::Plan(args) => plan::run(args),
        BenchmarkCommand::Run(args) => drive::run(args),
        BenchmarkCommand::Resume { out, shard, workers, done, metrics } => {
            drive::resume(out, shard.as_deref(), *workers, &drive::Now { done, metrics: *metrics, again: None })
        }
        BenchmarkCommand::Merge { folders, force, out } => {
            let merged = ds_benchmark::merge(folders, out, *force)?;
            tell(&merged);
            answer(&format!("results: {}", out.display()));
            Ok(if merged.complete() { Ended::Complete } else { Ended::Left })
        }
        BenchmarkCommand::Report { folder, published, verdicts, recordings } => {
            tables::run(folder, published, verdicts, recordings)
        }
        BenchmarkCommand::Scale(args) => scale::run(args, log),
    }
}

/// Says what was merged, and what is missing.
fn tell(merged: &Merged) {
    answer(&format!("{} of {} cells ended", merged.ended, merged.cells));
    merged.torn.iter().for_each(|file| answer(&format!("torn last line: {}", file.display())));
    if merged.mixed {
        answer("mixed: parts of other benchmarks were merged by force");
    }
    if merged.foreign > 0 {
        answer(&format!("{} records of other benchmarks are in no table", merged.foreign));
    }
    for (what, cells) in [("aborted", &merged.aborted), ("missing", &merged.missing)] {
        cells.iter().take(20).for_each(|cell| answer(&format!("{what}: {cell}")));
        if cells.len() > 20 {
            answer(&format!("{what}: {} more, see merged.json", cells.len() - 20));
        }
    }
}

/// Says what is in a set.
fn describe(set: &Manifest) {
    let (left_out, kind) = (set.recipe.candidates.saturating_sub(set.entries.len() as u64), set.kind);
    answer(&format!(
        "{} ({kind:?}): {} entries, licence {}, digest {}",
        set.name,
        set.entries.len(),
        set.licence,
        set.digest
    ));
    let mut categories: std::collections::BTreeMap<&str, usize> = std::collections::BTreeMap::new();
    set.entries.iter().for_each(|entry| *categories.entry(&entry.category).or_default() += 1);
    let named = |name: &str| if name.is_empty() { "of no category" } else { name }.to_owned();
    let shares: Vec<String> = categories.iter().map(|(name, count)| format!("{} {count}", named(name))).collect();
    answer(&format!("  {}", shares.join(", ")));
    if left_out > 0 {
        answer(&format!("  of {} candidates {left_out} are left out:", set.recipe.candidates));
    }
    for (reason, count) in &set.recipe.rejected {
        let share = 100.0 * *count as f64 / set.recipe.candidates.max(1) as f64;
        answer(&format!("    {reason}: {count} ({share:.1} %)"));
    }
}

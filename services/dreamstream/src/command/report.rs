//! `report`, `compare` and `merge`: results of finished runs as tables, pages and one file.

use std::path::Path;

use anyhow::{Context, Result};
use ds_process::service::UsageError;
use ds_process::terminal::answer;
use ds_run_report::write::folder::{all as write, pictures};
use ds_run_report::write::markdown;
use ds_run_report::{Dimension, Pairing, RESULTS, Report, ReportOptions, Results, compare};

use crate::cli::{CompareArgs, MergeArgs, ReportArgs};
use crate::command::recording;

/// Reads the results of a run, given its folder or the file itself, and looks at its recordings; what is wrong with them is
/// added to `damaged`.
fn load(path: &Path, partial: bool, damaged: &mut Vec<String>) -> Result<Results> {
    let file = if path.is_dir() { path.join(RESULTS) } else { path.to_path_buf() };
    let results = Results::load(&file)?;
    let found = recording::inspect(&results, file.parent().unwrap_or(Path::new(".")), partial)?;
    damaged.extend(found);
    Ok(results)
}

/// Writes tables and a page over some runs.
///
/// # Errors
/// If a results file is refused or a file cannot be written.
pub(crate) fn run(args: &ReportArgs) -> Result<()> {
    let mut damaged = Vec::new();
    let runs = args.runs.iter().map(|path| load(path, args.partial, &mut damaged)).collect::<Result<Vec<_>>>()?;
    let by_wall_clock = runs.iter().filter(|results| results.by_wall_clock()).count();
    if by_wall_clock != 0 && by_wall_clock != runs.len() {
        let says =
            format!("{by_wall_clock} of {} runs were driven by the wall clock: report on them apart", runs.len());
        return Err(UsageError(says).into());
    }
    let report = Report::new(&runs, Vec::new(), &options(args.base_set.as_deref())).with_partial(damaged);
    write(&args.out, &runs, &report, &pictures(&args.out, &args.runs, &runs))?;
    answer(&markdown::report(&report));
    answer(&format!("report: {}", args.out.join("report.html").display()));
    Ok(())
}

/// Compares two runs on the scenarios that both drove.
///
/// # Errors
/// If a results file is refused or a file cannot be written.
pub(crate) fn compare_runs(args: &CompareArgs) -> Result<()> {
    let mut damaged = Vec::new();
    let a = load(&args.run_a, args.partial, &mut damaged)?;
    let b = load(&args.run_b, args.partial, &mut damaged)?;
    if a.by_wall_clock() != b.by_wall_clock() && !args.force {
        let (a, b) = (args.run_a.display(), args.run_b.display());
        let says =
            format!("only one of {a} and {b} was driven by the wall clock; `--force` compares them all the same");
        return Err(UsageError(says).into());
    }
    let policies = |results: &Results| {
        let mut names: Vec<&str> = results.episodes.iter().map(|episode| episode.policy.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        names.len()
    };
    let by = if policies(&a) > 1 && policies(&b) > 1 { vec![Dimension::Policy] } else { Vec::new() };
    let comparison = compare(&a, &b, &Pairing { by, ..Pairing::default() }, 0);
    damaged.iter().for_each(|line| answer(&format!("partial: {line}")));
    answer(&markdown::comparison(&comparison));
    if let Some(out) = &args.out {
        let runs = [a, b];
        let pictures = pictures(out, &[args.run_a.clone(), args.run_b.clone()], &runs);
        let report = Report::new(&runs, vec![comparison], &options(None)).with_partial(damaged);
        write(out, &runs, &report, &pictures)?;
        answer(&format!("report: {}", out.join("report.html").display()));
    }
    Ok(())
}

/// Puts the episodes of several runs, such as the shards of one, into one results file.
///
/// # Errors
/// If a results file is refused, settings differ, or a drive is there twice.
pub(crate) fn merge(args: &MergeArgs) -> Result<()> {
    let mut damaged = Vec::new();
    let runs = args.runs.iter().map(|path| Ok((path.clone(), load(path, args.partial, &mut damaged)?)));
    let merged = Results::merge(runs.collect::<Result<_>>()?, args.force)?;
    damaged.iter().for_each(|line| answer(&format!("partial: {line}")));
    std::fs::create_dir_all(&args.out).with_context(|| format!("create {}", args.out.display()))?;
    merged.save(&args.out.join(RESULTS))?;
    answer(&merged.table());
    answer(&format!("results: {}", args.out.display()));
    Ok(())
}

fn options(base_set: Option<&str>) -> ReportOptions {
    let mut options = ReportOptions::default();
    if let Some(set) = base_set {
        set.clone_into(&mut options.base_set);
    }
    options
}

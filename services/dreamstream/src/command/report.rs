//! `report`, `compare` and `merge`: results of finished runs as tables, pages and one file.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use ds_run_report::write::{arrow, csv, html, json, markdown};
use ds_run_report::{Comparison, Dimension, Pairing, Picture, Report, ReportOptions, Results, compare};

use crate::cli::{CompareArgs, MergeArgs, ReportArgs};
use crate::command::answer;

/// The name of a run's results file in its folder.
pub(crate) const RESULTS: &str = "results.json";

/// Reads the results of a run, given its folder or the file itself.
fn load(path: &Path) -> Result<Results> {
    let file = if path.is_dir() { path.join(RESULTS) } else { path.to_path_buf() };
    Ok(Results::load(&file)?)
}

/// Writes tables and a page over some runs.
///
/// # Errors
/// If a results file is refused or a file cannot be written.
pub(crate) fn run(args: &ReportArgs) -> Result<()> {
    let runs = args.runs.iter().map(|path| load(path)).collect::<Result<Vec<_>>>()?;
    let report = Report::new(&runs, Vec::new(), &options(args.base_set.as_deref()));
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
    let (a, b) = (load(&args.run_a)?, load(&args.run_b)?);
    let policies = |results: &Results| {
        let mut names: Vec<&str> = results.episodes.iter().map(|episode| episode.policy.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        names.len()
    };
    let by = if policies(&a) > 1 && policies(&b) > 1 { vec![Dimension::Policy] } else { Vec::new() };
    let comparison = compare(&a, &b, &Pairing { by, ..Pairing::default() }, 0);
    answer(&markdown::comparison(&comparison));
    if let Some(out) = &args.out {
        let runs = [a, b];
        write_compared(out, &runs, comparison, &pictures(out, &[args.run_a.clone(), args.run_b.clone()], &runs))?;
        answer(&format!("report: {}", out.join("report.html").display()));
    }
    Ok(())
}

fn write_compared(out: &Path, runs: &[Results], comparison: Comparison, pictures: &[Picture]) -> Result<()> {
    let report = Report::new(runs, vec![comparison], &options(None));
    write(out, runs, &report, pictures)
}

/// Puts the episodes of several runs, such as the shards of one, into one results file.
///
/// # Errors
/// If a results file is refused, settings differ, or a drive is there twice.
pub(crate) fn merge(args: &MergeArgs) -> Result<()> {
    let mut runs = args.runs.iter().map(|path| Ok((path, load(path)?))).collect::<Result<Vec<_>>>()?.into_iter();
    let (first, mut merged) = runs.next().context("nothing to merge")?;
    for (path, results) in runs {
        let same = (&results.run.version, &results.run.video_model_digest, &results.run.policy_model_digest)
            == (&merged.run.version, &merged.run.video_model_digest, &merged.run.policy_model_digest);
        let settings = |run: &ds_run_report::Run| {
            let ds_run_report::Run { replan_period, horizon_secs, history, agents, tracker, .. } = run.clone();
            (replan_period, horizon_secs.to_bits(), history, agents, tracker)
        };
        ensure!(
            args.force || (same && settings(&results.run) == settings(&merged.run)),
            "{} and {} ran with other versions, weights or settings; `--force` merges them all the same",
            first.display(),
            path.display()
        );
        merged.run.wall_s += results.run.wall_s;
        merged.run.insecure |= results.run.insecure;
        merged.run.seeds.extend(results.run.seeds);
        let folder = if path.is_dir() { path.as_path() } else { path.parent().unwrap_or(Path::new(".")) };
        let here = folder.canonicalize().with_context(|| format!("path of {}", folder.display()))?;
        merged.episodes.extend(results.episodes.into_iter().map(|mut episode| {
            if !episode.recording.is_empty() && Path::new(&episode.recording).is_relative() {
                episode.recording = here.join(&episode.recording).display().to_string();
            }
            episode
        }));
    }
    merged.run.seeds.sort_unstable();
    merged.run.seeds.dedup();
    std::fs::create_dir_all(&args.out).with_context(|| format!("create {}", args.out.display()))?;
    merged.save(&args.out.join(RESULTS))?;
    answer(&merged.table());
    answer(&format!("results: {}", args.out.display()));
    Ok(())
}

/// Writes the tables and the page of one run into its folder.
///
/// # Errors
/// If a file cannot be written.
pub(crate) fn write_for(out: &Path, results: &Results) -> Result<()> {
    let runs = std::slice::from_ref(results);
    let report = Report::new(runs, Vec::new(), &options(None));
    write(out, runs, &report, &pictures(out, &[out.to_path_buf()], runs))
}

fn options(base_set: Option<&str>) -> ReportOptions {
    let mut options = ReportOptions::default();
    if let Some(set) = base_set {
        set.clone_into(&mut options.base_set);
    }
    options
}

fn write(out: &Path, runs: &[Results], report: &Report, pictures: &[Picture]) -> Result<()> {
    std::fs::create_dir_all(out).with_context(|| format!("create {}", out.display()))?;
    let files: [(&str, Vec<u8>); 7] = [
        ("report.html", html::page(report, runs, pictures).into_bytes()),
        ("report.json", json(report).context("report as JSON")?.into_bytes()),
        ("report.md", markdown::report(report).into_bytes()),
        ("episodes.csv", csv::episodes(runs).into_bytes()),
        ("episodes.arrow", arrow::episodes(runs).context("episodes as Arrow")?),
        ("aggregate.csv", csv::aggregate(&report.headline).into_bytes()),
        ("aggregate.arrow", arrow::aggregate(&report.headline).context("aggregate as Arrow")?),
    ];
    for (name, bytes) in files {
        let path = out.join(name);
        std::fs::write(&path, bytes).with_context(|| format!("write {}", path.display()))?;
    }
    Ok(())
}

/// Finds the animations beside the recordings, as paths that a page in `out` can follow.
fn pictures(out: &Path, folders: &[PathBuf], runs: &[Results]) -> Vec<Picture> {
    let mut found = Vec::new();
    for (run, (folder, results)) in folders.iter().zip(runs).enumerate() {
        let folder = if folder.is_dir() { folder.as_path() } else { folder.parent().unwrap_or(Path::new(".")) };
        for (episode, entry) in results.episodes.iter().enumerate() {
            let Some(stem) = Path::new(&entry.recording).file_stem() else { continue };
            let name = format!("pictures/{}.gif", stem.to_string_lossy());
            let file = folder.join(&name);
            if file.exists() {
                let path = if folder == out { name } else { absolute(&file) };
                found.push(Picture { run, episode, path });
            }
        }
    }
    found
}

fn absolute(path: &Path) -> String {
    path.canonicalize().unwrap_or_else(|_| path.to_path_buf()).display().to_string()
}

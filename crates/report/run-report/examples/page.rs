//! Writes the page of some runs: `cargo run -p ds-run-report --example page -- OUT RESULTS.json...`.
//!
//! OUT is a folder; it gets `report.html`, `report.json`, `report.md`, `episodes.csv`, `episodes.arrow`,
//! `aggregate.csv` and `aggregate.arrow`. Two runs are also compared. Pictures are those in `OUT/pictures`, named
//! after the recordings.

use std::path::{Path, PathBuf};

use ds_run_report::write::{arrow, csv, html, json, markdown};
use ds_run_report::{Pairing, Picture, Report, ReportOptions, Results, compare};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1).map(PathBuf::from);
    let out = arguments.next().ok_or("which folder is it for?")?;
    let runs: Vec<Results> = arguments.map(|path| Results::load(&path)).collect::<Result<_, _>>()?;
    let comparisons = match runs.as_slice() {
        [a, b] => vec![compare(a, b, &Pairing::default(), 0)],
        _ => Vec::new(),
    };
    let report = Report::new(&runs, comparisons, &ReportOptions::default());
    std::fs::create_dir_all(&out)?;
    std::fs::write(out.join("report.html"), html::page(&report, &runs, &pictures(&out, &runs)))?;
    std::fs::write(out.join("report.json"), json(&report)?)?;
    std::fs::write(out.join("report.md"), markdown::report(&report))?;
    std::fs::write(out.join("episodes.csv"), csv::episodes(&runs))?;
    std::fs::write(out.join("episodes.arrow"), arrow::episodes(&runs)?)?;
    std::fs::write(out.join("aggregate.csv"), csv::aggregate(&report.headline))?;
    std::fs::write(out.join("aggregate.arrow"), arrow::aggregate(&report.headline)?)?;
    Ok(())
}

fn pictures(out: &Path, runs: &[Results]) -> Vec<Picture> {
    let mut pictures = Vec::new();
    for (run, results) in runs.iter().enumerate() {
        for (index, episode) in results.episodes.iter().enumerate() {
            let Some(stem) = Path::new(&episode.recording).file_stem() else { continue };
            let path = format!("pictures/{}.gif", stem.to_string_lossy());
            if out.join(&path).exists() {
                pictures.push(Picture { run, episode: index, path });
            }
        }
    }
    pictures
}

//! A report with all its files in one folder, and the pictures that a page there can show.

use std::path::{Path, PathBuf};

use super::{arrow, csv, html, json, markdown};
use crate::report::{Picture, Report, ReportOptions};
use crate::results::{Results, folder_of};

/// Why a report cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// A file or the folder cannot be written.
    #[error("write {}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The report cannot be written as JSON.
    #[error("report as JSON")]
    Json(#[from] serde_json::Error),
    /// A table cannot be written as Arrow.
    #[error("table as Arrow")]
    Arrow(#[from] arrow_schema::ArrowError),
}

/// Writes tables and page into a folder, which is made where it is not there.
///
/// # Errors
/// If a file cannot be written.
pub fn all(out: &Path, runs: &[Results], report: &Report, pictures: &[Picture]) -> Result<(), WriteError> {
    let failed = |path: &Path, source| WriteError::File { path: path.to_path_buf(), source };
    std::fs::create_dir_all(out).map_err(|source| failed(out, source))?;
    let files: [(&str, Vec<u8>); 7] = [
        ("report.html", html::page(report, runs, pictures).into_bytes()),
        ("report.json", json(report)?.into_bytes()),
        ("report.md", markdown::report(report).into_bytes()),
        ("episodes.csv", csv::episodes(runs).into_bytes()),
        ("episodes.arrow", arrow::episodes(runs)?),
        ("aggregate.csv", csv::aggregate(&report.headline).into_bytes()),
        ("aggregate.arrow", arrow::aggregate(&report.headline)?),
    ];
    for (name, bytes) in files {
        let path = out.join(name);
        std::fs::write(&path, bytes).map_err(|source| failed(&path, source))?;
    }
    Ok(())
}

/// Writes tables and page of one run into its folder.
///
/// # Errors
/// If a file cannot be written.
pub fn of_run(out: &Path, results: &Results) -> Result<(), WriteError> {
    let runs = std::slice::from_ref(results);
    let report = Report::new(runs, Vec::new(), &ReportOptions::default());
    all(out, runs, &report, &pictures(out, &[out.to_path_buf()], runs))
}

/// Finds the animations beside the recordings of runs, given their folders or results files, as paths that a page in `out`
/// can follow.
#[must_use]
pub fn pictures(out: &Path, places: &[PathBuf], runs: &[Results]) -> Vec<Picture> {
    let mut found = Vec::new();
    for (run, (place, results)) in places.iter().zip(runs).enumerate() {
        let folder = folder_of(place);
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

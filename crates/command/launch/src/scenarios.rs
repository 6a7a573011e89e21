//! The scenario files that paths and folders on a command line name.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use ds_process::shipped;

/// Returns the scenario files of paths and folders, sorted within each folder.
///
/// # Errors
/// If a path does not exist or a folder holds no scenario.
pub fn files(paths: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for path in paths {
        if path.is_dir() {
            let found = ds_scenario::list(path)?;
            ensure!(!found.is_empty(), "no *.scenario.json in {}", path.display());
            files.extend(found);
        } else {
            ensure!(path.exists(), "no such file or folder: {}", shipped::describe(path));
            files.push(path.clone());
        }
    }
    Ok(files)
}

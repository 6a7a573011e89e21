//! Importers of other logs. Each reads untrusted files as data and ends in the same checks as our own format.
//!
//! One file per log format; `import_path` takes a file or a folder and writes one scenario file for each log.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use ds_world::Scene;

pub mod nuscenes;
pub mod openscene;
mod pickle;
mod recorded;
pub mod scenarionet;
mod view;

pub use pickle::PickleError;
pub use recorded::Recorded;

use crate::store::{SUFFIX, ScenarioError, Warning, save};

/// The largest log file that is read, in bytes.
pub const MAX_FILE_BYTES: u64 = 256 << 20;

/// Says why a log cannot be imported.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The file or folder cannot be read.
    #[error("cannot read {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is over [`MAX_FILE_BYTES`].
    #[error("log file has more than {limit} bytes: {}", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// The limit.
        limit: u64,
    },
    /// There is no log in the folder.
    #[error("no *.pkl log in {}", path.display())]
    Empty {
        /// The folder.
        path: PathBuf,
    },
    /// The pickle is refused.
    #[error("log refused: {}", path.display())]
    Pickle {
        /// The file.
        path: PathBuf,
        /// Why.
        source: PickleError,
    },
    /// A field is missing or holds something else than the format says.
    #[error("log refused: field {at:?} {problem} ({})", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// The path inside the log.
        at: String,
        /// What is wrong.
        problem: String,
    },
    /// The scenario cannot be written.
    #[error("cannot save the imported scenario")]
    Save(#[from] ScenarioError),
}

/// What became of one log.
#[derive(Debug)]
pub struct Imported {
    /// The log.
    pub log: PathBuf,
    /// The scenario file, with what is odd about it, or why there is none.
    pub outcome: Result<(PathBuf, Vec<Warning>), ImportError>,
}

/// Reads one log file.
///
/// # Errors
/// [`ImportError`] names the file, the field and what is wrong.
pub fn read(path: &Path) -> Result<(Scene, Vec<Warning>), ImportError> {
    let unreadable = |source| ImportError::Read { path: path.to_owned(), source };
    let file = File::open(path).map_err(unreadable)?;
    let mut bytes = Vec::new();
    file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(ImportError::TooLarge { path: path.to_owned(), limit: MAX_FILE_BYTES });
    }
    scenarionet::scene(&bytes, path)
}

/// Imports a log, or every `*.pkl` of a folder (indices named `dataset_*` left out), to one scenario file each.
///
/// `progress` hears of each log when it is done. A bad log does not stop the others.
///
/// # Errors
/// [`ImportError`] only if the path itself cannot be read or holds no log.
pub fn import_path(
    path: &Path,
    out_dir: &Path,
    progress: &mut dyn FnMut(&Imported),
) -> Result<Vec<Imported>, ImportError> {
    let mut results = Vec::new();
    for log in logs(path)? {
        let outcome = read(&log).and_then(|(scene, warnings)| {
            let file = out_dir.join(format!("{}{SUFFIX}", scene.name));
            save(&scene, &file)?;
            Ok((file, warnings))
        });
        let imported = Imported { log, outcome };
        progress(&imported);
        results.push(imported);
    }
    Ok(results)
}

fn logs(path: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let unreadable = |source| ImportError::Read { path: path.to_owned(), source };
    if !std::fs::metadata(path).map_err(unreadable)?.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let mut logs = Vec::new();
    for entry in std::fs::read_dir(path).map_err(unreadable)? {
        let entry = entry.map_err(unreadable)?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.ends_with(".pkl") && !name.starts_with("dataset_") && !name.starts_with('.') {
            logs.push(entry.path());
        }
    }
    logs.sort();
    if logs.is_empty() { Err(ImportError::Empty { path: path.to_owned() }) } else { Ok(logs) }
}

#[cfg(test)]
mod tests;

//! Importers of other logs. Each reads untrusted files as data and ends in the same checks as our own format.
//!
//! One file per log format; `import_path` takes a file or a folder and writes one scenario file for each log. What
//! takes scenarios and logs alike tells them apart by file or folder (`files`, `open`).

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use ds_space::{CameraId, CameraModel, DVec3, Intrinsics};
use ds_world::Scene;

pub mod argoverse2;
mod nuplan;
pub mod nuscenes;
pub mod openscene;
mod pickle;
mod recorded;
pub mod scenarionet;
mod view;

pub use nuplan::{GeometryError, MapError};
pub use pickle::PickleError;
pub use recorded::Recorded;

use crate::store::{SUFFIX, ScenarioError, Warning, load, save};
use crate::{compose, resolve};

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
    #[error("no {wanted} in {}", path.display())]
    Empty {
        /// What is looked for.
        wanted: &'static str,
        /// The folder.
        path: PathBuf,
    },
    /// A log lacks a file.
    #[error("log has no {what}: {}", path.display())]
    Missing {
        /// The file, `*` standing for any text.
        what: String,
        /// The log.
        path: PathBuf,
    },
    /// A table is a parquet file.
    #[error("parquet is not read; write the table as CSV beside it: {command} {}", path.display())]
    Parquet {
        /// The file.
        path: PathBuf,
        /// The command that converts it.
        command: &'static str,
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
    /// The map of the log's city is refused.
    #[error("map refused: {}", path.display())]
    Map {
        /// The file.
        path: PathBuf,
        /// Why.
        source: MapError,
    },
    /// The scenario cannot be written.
    #[error("cannot save the imported scenario")]
    Save(#[from] ScenarioError),
    /// The scenario file is refused.
    #[error(transparent)]
    Load(ScenarioError),
}

impl ImportError {
    fn field(path: &Path, fault: view::FieldFault) -> Self {
        Self::Field { path: path.to_owned(), at: fault.at, problem: fault.problem }
    }
}

/// A format of logs that become scenario files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Pickles of ScenarioNet and MetaDrive.
    ScenarioNet,
    /// Folders of Argoverse 2.
    Argoverse2,
    /// Pickles of OpenScene and NAVSIM, with nuPlan's maps. Told by its name alone: the files are named as others are.
    OpenScene,
}

impl Format {
    /// All formats.
    pub const ALL: [Self; 3] = [Self::ScenarioNet, Self::Argoverse2, Self::OpenScene];

    /// Returns the name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::ScenarioNet => "scenarionet",
            Self::Argoverse2 => "argoverse2",
            Self::OpenScene => "openscene",
        }
    }

    /// Returns the format of a log, told by its name or its files, pickles as ScenarioNet's; `None` for what is no log.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if name.ends_with(".pkl") && !name.starts_with("dataset_") && !name.starts_with('.') {
            return Some(Self::ScenarioNet);
        }
        argoverse2::is_log(path).then_some(Self::Argoverse2)
    }

    /// Says what a log of the format is.
    fn log(self) -> &'static str {
        match self {
            Self::ScenarioNet => "*.pkl log",
            Self::Argoverse2 => "log of Argoverse 2 (city_SE3_egovehicle*, or scenario* and log_map_archive*.json)",
            Self::OpenScene => "*.pkl log of OpenScene",
        }
    }

    /// Reads a log found under a root; `maps` is for OpenScene.
    fn read(self, path: &Path, root: &Path, maps: Option<&Path>) -> Result<(Scene, Vec<Warning>), ImportError> {
        match self {
            Self::ScenarioNet => scenarionet::scene(&bytes(path)?, path),
            Self::Argoverse2 => argoverse2::read(path),
            Self::OpenScene => openscene::scene(root, path, maps),
        }
    }
}

/// What became of one log.
#[derive(Debug)]
pub struct Imported {
    /// The log.
    pub log: PathBuf,
    /// The scenario file, with what is odd about it, or why there is none.
    pub outcome: Result<(PathBuf, Vec<Warning>), ImportError>,
}

/// Reads one log, its format told by [`Format::of`], or a scenario file.
///
/// # Errors
/// [`ImportError`] names the file, the field and what is wrong.
pub fn open(path: &Path) -> Result<(Scene, Vec<Warning>), ImportError> {
    Format::of(path).map_or_else(|| load(path).map_err(ImportError::Load), |format| format.read(path, path, None))
}

/// Returns a file or log itself, or the scenario files and logs of a folder, in order.
///
/// # Errors
/// If the folder cannot be read.
pub fn files(path: &Path) -> std::io::Result<Vec<PathBuf>> {
    let known = |path: &Path| path.to_string_lossy().ends_with(SUFFIX) || Format::of(path).is_some();
    if known(path) || !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    entries(path, &known)
}

/// Returns the wanted entries of a folder, in order.
fn entries(folder: &Path, wanted: &dyn Fn(&Path) -> bool) -> std::io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if wanted(&path) {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// Reads a file of bounded size.
fn bytes(path: &Path) -> Result<Vec<u8>, ImportError> {
    let unreadable = |source| ImportError::Read { path: path.to_owned(), source };
    let file = File::open(path).map_err(unreadable)?;
    let mut bytes = Vec::new();
    file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(ImportError::TooLarge { path: path.to_owned(), limit: MAX_FILE_BYTES });
    }
    Ok(bytes)
}

/// Puts a scene through the checks of our own format.
fn checked(scene: &Scene, path: &Path) -> Result<Scene, ImportError> {
    resolve::scene(&compose::document(scene)).map_err(|fault| ImportError::Field {
        path: path.to_owned(),
        at: fault.at,
        problem: fault.problem,
    })
}

/// Returns a name made safe for file names.
fn safe_name(name: &str) -> String {
    let safe = |c: char| if c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.') { c } else { '-' };
    let name: String = name.chars().map(safe).take(80).collect();
    let name = name.trim_start_matches('.');
    if name.is_empty() { "imported".to_owned() } else { name.to_owned() }
}

/// The camera of logs that tell of none.
fn usual_camera() -> CameraModel {
    let intrinsics = Intrinsics::centred(160, 96, 70f64.to_radians());
    let id = CameraId::new("front").expect("a plain word is an id");
    CameraModel::mounted(id, intrinsics, DVec3::new(1.5, 0.0, 1.6), 0.0, 0.05)
}

/// Imports a log, or every log of a folder (indices named `dataset_*` left out), to one scenario file each.
///
/// `maps` is the folder of nuPlan's maps that drives of OpenScene are laid on, see [`openscene::read`]; other formats
/// bring their maps. `progress` hears of each log when it is done. A bad log does not stop the others.
///
/// # Errors
/// [`ImportError`] only if the path itself cannot be read or holds no log.
pub fn import_path(
    format: Format,
    path: &Path,
    maps: Option<&Path>,
    out_dir: &Path,
    progress: &mut dyn FnMut(&Imported),
) -> Result<Vec<Imported>, ImportError> {
    let mut results = Vec::new();
    for log in logs(format, path)? {
        let outcome = format.read(&log, path, maps).and_then(|(scene, warnings)| {
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

fn logs(format: Format, path: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let unreadable = |source| ImportError::Read { path: path.to_owned(), source };
    let wanted = |path: &Path| Format::of(path) == Some(format);
    if !std::fs::metadata(path).map_err(unreadable)?.is_dir() || wanted(path) {
        return Ok(vec![path.to_owned()]);
    }
    if format == Format::OpenScene {
        return openscene::logs(path);
    }
    let logs = entries(path, &wanted).map_err(unreadable)?;
    if logs.is_empty() { Err(ImportError::Empty { wanted: format.log(), path: path.to_owned() }) } else { Ok(logs) }
}

#[cfg(test)]
mod tests;

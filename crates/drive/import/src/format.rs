//! The formats of logs that become scenario files: told apart by name and files, read one by one or by the folder.

use std::path::{Path, PathBuf};

use ds_scenario::store::SUFFIX;
use ds_scenario::{Warning, load, save};
use ds_world::Scene;

use crate::error::ImportError;
use crate::file::{bytes, entries};
use crate::{argoverse2, commonroad, openscene, scenarionet};

/// A format of logs that become scenario files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Pickles of ScenarioNet and MetaDrive.
    ScenarioNet,
    /// Folders of Argoverse 2.
    Argoverse2,
    /// Pickles of OpenScene and NAVSIM, with nuPlan's maps. Told by its name alone: the files are named as others are.
    OpenScene,
    /// XML files of CommonRoad.
    CommonRoad,
}

/// What is chosen of logs beside their format.
#[derive(Debug, Clone, Copy, Default)]
pub struct Choice<'a> {
    /// The folder of nuPlan's maps that drives of OpenScene are laid on, see [`openscene::read`]; other formats bring
    /// their maps.
    pub maps: Option<&'a Path>,
    /// Who is the ego of a CommonRoad file, see [`commonroad::scene`]; [`Self::RECORDED`] for every recorded vehicle
    /// in turn.
    pub ego: Option<&'a str>,
}

impl Choice<'_> {
    /// Chooses every vehicle that [`commonroad::recorded`] names, each for a scenario of its own.
    pub const RECORDED: &'static str = "recorded";
}

impl Format {
    /// All formats.
    pub const ALL: [Self; 4] = [Self::ScenarioNet, Self::Argoverse2, Self::OpenScene, Self::CommonRoad];

    /// Returns the name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::ScenarioNet => "scenarionet",
            Self::Argoverse2 => "argoverse2",
            Self::OpenScene => "openscene",
            Self::CommonRoad => "commonroad",
        }
    }

    /// Returns the format of a log, told by its name or its files, pickles as ScenarioNet's; `None` for what is no log.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if name.ends_with(".pkl") && !name.starts_with("dataset_") && !name.starts_with('.') {
            return Some(Self::ScenarioNet);
        }
        if commonroad::is_log(path) {
            return Some(Self::CommonRoad);
        }
        argoverse2::is_log(path).then_some(Self::Argoverse2)
    }

    /// Says what a log of the format is.
    fn log(self) -> &'static str {
        match self {
            Self::ScenarioNet => "*.pkl log",
            Self::Argoverse2 => "log of Argoverse 2 (city_SE3_egovehicle*, or scenario* and log_map_archive*.json)",
            Self::OpenScene => "*.pkl log of OpenScene",
            Self::CommonRoad => "*.xml file of CommonRoad",
        }
    }

    /// Reads a log found under a root.
    fn read(self, path: &Path, root: &Path, choice: Choice<'_>) -> Result<(Scene, Vec<Warning>), ImportError> {
        match self {
            Self::ScenarioNet => scenarionet::scene(&bytes(path)?, path),
            Self::Argoverse2 => argoverse2::read(path),
            Self::OpenScene => openscene::scene(root, path, choice.maps),
            Self::CommonRoad => commonroad::scene(&bytes(path)?, path, choice.ego),
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
    Format::of(path)
        .map_or_else(|| load(path).map_err(ImportError::Load), |format| format.read(path, path, Choice::default()))
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

/// Imports a log, or every log of a folder (indices named `dataset_*` left out), to one scenario file each, to one for
/// each ego where all of a recording are chosen.
///
/// `progress` hears of each scenario when it is done. A bad log does not stop the others.
///
/// # Errors
/// [`ImportError`] only if the path itself cannot be read or holds no log.
pub fn import_path(
    format: Format,
    path: &Path,
    choice: Choice<'_>,
    out_dir: &Path,
    progress: &mut dyn FnMut(&Imported),
) -> Result<Vec<Imported>, ImportError> {
    let mut results = Vec::new();
    for log in logs(format, path)? {
        let one = |ego: Option<&str>| {
            let (scene, warnings) = format.read(&log, path, Choice { ego, ..choice })?;
            let file = out_dir.join(format!("{}{SUFFIX}", scene.name));
            save(&scene, &file)?;
            Ok((file, warnings))
        };
        let outcomes = match choice.ego {
            Some(Choice::RECORDED) => match bytes(&log).and_then(|bytes| commonroad::recorded(&bytes, &log)) {
                Ok(egos) => egos.iter().map(|ego| one(Some(ego))).collect(),
                Err(error) => vec![Err(error)],
            },
            ego => vec![one(ego)],
        };
        for outcome in outcomes {
            let imported = Imported { log: log.clone(), outcome };
            progress(&imported);
            results.push(imported);
        }
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

//! Scenario files on disk: load with checks, save in one step, list, describe.
//!
//! Every error names the file, the place in it and the value. A file is read only up to a size limit.

use std::collections::BTreeMap;
use std::fmt::{self, Write as _};
use std::fs::File;
use std::io::{Read, Write as _};
use std::path::{Path, PathBuf};

use ds_space::plane;
use ds_world::{LaneKind, Scene};

use crate::document::Document;
use crate::place::Fault;
use crate::{compose, pretty, resolve};

/// The largest scenario file that is read, in bytes.
pub const MAX_FILE_BYTES: u64 = 64 << 20;
/// How scenario files end.
pub const SUFFIX: &str = ".scenario.json";

/// Says why a scenario file cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum ScenarioError {
    /// The file or folder cannot be read.
    #[error("cannot read {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is over [`MAX_FILE_BYTES`].
    #[error("scenario file has more than {limit} bytes: {}", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// The limit.
        limit: u64,
    },
    /// The text is no JSON or does not have the shape of the format.
    #[error("scenario refused: at {at:?}: {problem} ({})", path.display())]
    Shape {
        /// The file.
        path: PathBuf,
        /// The path inside the document.
        at: String,
        /// What is wrong, with line and column.
        problem: String,
    },
    /// A value is out of bounds, or names something that does not exist.
    #[error("scenario refused: field {at:?} {problem} ({})", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// The path inside the document.
        at: String,
        /// What is wrong, with the value.
        problem: String,
    },
    /// The file cannot be written.
    #[error("cannot write {}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}

/// Something about a valid scenario that its author may not have meant.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Warning {
    /// The path inside the document.
    pub at: String,
    /// What is odd, with the value.
    pub message: String,
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.at, self.message)
    }
}

/// Reads and checks a scenario file.
///
/// # Errors
/// [`ScenarioError`] names the file, the place in it and the value.
pub fn load(path: &Path) -> Result<(Scene, Vec<Warning>), ScenarioError> {
    let unreadable = |source| ScenarioError::Read { path: path.to_owned(), source };
    let file = File::open(path).map_err(unreadable)?;
    let mut bytes = Vec::new();
    file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(ScenarioError::TooLarge { path: path.to_owned(), limit: MAX_FILE_BYTES });
    }
    parse(&bytes, path)
}

/// Checks the text of a scenario file; `path` is only for messages.
///
/// # Errors
/// [`ScenarioError`] as for [`load`].
pub fn parse(bytes: &[u8], path: &Path) -> Result<(Scene, Vec<Warning>), ScenarioError> {
    let mut reader = serde_json::Deserializer::from_slice(bytes);
    let shape = |at: String, problem: String| ScenarioError::Shape { path: path.to_owned(), at, problem };
    let document: Document = serde_path_to_error::deserialize(&mut reader)
        .map_err(|error| shape(error.path().to_string(), error.into_inner().to_string()))?;
    reader.end().map_err(|error| shape(".".to_owned(), error.to_string()))?;
    let scene = resolve::scene(&document).map_err(|fault| invalid(fault, path))?;
    let warnings = warnings(&scene);
    Ok((scene, warnings))
}

fn invalid(fault: Fault, path: &Path) -> ScenarioError {
    ScenarioError::Invalid { path: path.to_owned(), at: fault.at, problem: fault.problem }
}

/// Puts a scene of another origin through the checks of the format and returns it as its file would be loaded.
///
/// # Errors
/// [`Fault`] names the first field that the format refuses.
pub fn checked(scene: &Scene) -> Result<Scene, Fault> {
    resolve::scene(&compose::document(scene))
}

/// Returns the text of a scene's file.
///
/// # Errors
/// [`ScenarioError::Invalid`] if the scene could not be loaded again.
pub fn to_text(scene: &Scene, path: &Path) -> Result<String, ScenarioError> {
    let document = compose::document(scene);
    resolve::scene(&document).map_err(|fault| invalid(fault, path))?;
    let compact = serde_json::to_string(&document)
        .map_err(|error| ScenarioError::Write { path: path.to_owned(), source: error.into() })?;
    Ok(pretty::lay_out(&compact))
}

/// Writes a scene's file in one step, making its folder where needed: readers see the old file or the whole new one.
///
/// # Errors
/// [`ScenarioError`] if the scene is not valid or the file cannot be written.
pub fn save(scene: &Scene, path: &Path) -> Result<(), ScenarioError> {
    let text = to_text(scene, path)?;
    let partial = path.with_extension("json.partial");
    let write = || {
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)?;
        }
        let mut file = File::create(&partial)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        std::fs::rename(&partial, path)
    };
    write().map_err(|source| ScenarioError::Write { path: path.to_owned(), source })
}

/// Returns the scenario files of a folder and the folders in it, sorted.
///
/// # Errors
/// [`ScenarioError::Read`] if a folder cannot be read.
pub fn list(folder: &Path) -> Result<Vec<PathBuf>, ScenarioError> {
    const DEPTH: usize = 8;
    let mut files = Vec::new();
    let mut folders = vec![(folder.to_owned(), 0)];
    while let Some((folder, depth)) = folders.pop() {
        let unreadable = |source| ScenarioError::Read { path: folder.clone(), source };
        for entry in std::fs::read_dir(&folder).map_err(unreadable)? {
            let entry = entry.map_err(unreadable)?;
            let path = entry.path();
            if entry.file_type().map_err(unreadable)?.is_dir() {
                if depth < DEPTH {
                    folders.push((path, depth + 1));
                }
            } else if path.to_string_lossy().ends_with(SUFFIX) {
                files.push(path);
            }
        }
    }
    files.sort();
    Ok(files)
}

/// Returns a summary of a scene in a few lines.
#[must_use]
pub fn describe(scene: &Scene) -> String {
    let driven_m: f64 =
        scene.ego_log.windows(2).map(|pair| pair[0].pose.position.distance(pair[1].pose.position)).sum();
    let top_mps = scene.ego_log.iter().map(|state| state.speed_mps()).fold(0.0, f64::max);
    let mut classes: BTreeMap<_, usize> = BTreeMap::new();
    for track in &scene.tracks {
        *classes.entry(track.class).or_default() += 1;
    }
    let classes: Vec<String> =
        classes.iter().map(|(class, count)| format!("{count} {}", format!("{class:?}").to_lowercase())).collect();
    let map = &scene.map;
    let connectors = map.lanes.iter().filter(|lane| lane.kind == LaneKind::Connector).count();
    let cameras: Vec<String> = scene
        .cameras
        .iter()
        .map(|camera| format!("{} {}x{}", camera.id, camera.intrinsics.width_px, camera.intrinsics.height_px))
        .collect();
    let mut text = String::new();
    let ticks = scene.ego_log.len();
    let secs = (ticks.saturating_sub(1)) as f64 * scene.dt.secs();
    let family = if scene.family.is_empty() { "imported" } else { &scene.family };
    let lines = [
        format!("{} ({family}), digest {}", scene.name, scene.digest),
        format!("  {ticks} ticks, {secs:.1} s; the expert drives {driven_m:.1} m, at most {top_mps:.1} m/s"),
        format!("  tracks: {}", if classes.is_empty() { "none".to_owned() } else { classes.join(", ") }),
        format!(
            "  map: {} lanes, {connectors} of them connectors, {} crosswalks, {} stop lines, {} lights, {} structures",
            map.lanes.len(),
            map.crosswalks.len(),
            map.stop_lines.len(),
            map.traffic_lights.len(),
            map.structures.len()
        ),
        format!("  cameras: {}", cameras.join(", ")),
        format!("  prompt: {}", scene.prompt),
        format!("  origin: {} ({})", scene.origin.source, scene.origin.licence),
    ];
    for line in lines {
        writeln!(text, "{line}").expect("writing to a string succeeds");
    }
    text
}

/// Returns what is odd about a valid scene.
#[must_use]
pub fn warnings(scene: &Scene) -> Vec<Warning> {
    let mut warnings = Vec::new();
    let mut warn = |at: &str, message: String| warnings.push(Warning { at: at.to_owned(), message });
    if scene.origin.licence.is_empty() {
        warn("origin.licence", "is empty".to_owned());
    }
    if scene.map.lanes.is_empty() {
        warn("map.lanes", "is empty; layouts will show no road".to_owned());
    }
    let start = scene.ego_log[0].pose.position;
    if let Some(off_m) =
        plane::Path::new(&scene.route).map(|route| route.nearest(start).left_m.abs()).filter(|off_m| *off_m > 3.0)
    {
        warn("route_m", format!("passes {off_m:.2} m beside the start of the log"));
    }
    let outside = |state: &&ds_world::EgoState| {
        !scene.map.drivable.iter().any(|polygon| plane::polygon::holds(polygon, state.pose.position))
    };
    let count = scene.ego_log.iter().filter(outside).count();
    if count > 0 {
        warn("ego_log", format!("the rear axle is off the drivable area at {count} of {} ticks", scene.ego_log.len()));
    }
    for (tick, pair) in scene.ego_log.windows(2).enumerate() {
        let moved_mps = pair[0].pose.position.distance(pair[1].pose.position) / scene.dt.secs();
        let said_mps = 0.5 * (pair[0].velocity_mps.length() + pair[1].velocity_mps.length());
        if (moved_mps - said_mps).abs() > 1.5 + 0.3 * said_mps {
            warn(
                &format!("ego_log.x_m[{}]", tick + 1),
                format!("moves at {moved_mps:.2} m/s, its speed says {said_mps:.2} m/s"),
            );
            break;
        }
    }
    for (i, track) in scene.tracks.iter().enumerate().filter(|(_, track)| track.points.iter().all(Option::is_none)) {
        warn(&format!("tracks[{i}].valid_ticks"), format!("track {:?} is never seen", track.name));
    }
    warnings
}

#[cfg(test)]
mod tests;

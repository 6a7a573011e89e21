//! Logs of Argoverse 2, each a folder with its map: sensor logs and scenarios of motion forecasting.
//!
//! Positions are moved so that the drive begins at the origin. Tables may be Feather files, as the data set gives them,
//! or CSV files of the same columns. Quaternions are w, x, y, z; times in nanoseconds.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::path::{Path, PathBuf};

use ds_scenario::{Warning, warnings};
use ds_space::DVec2;
use ds_world::{AgentClass, Origin, Scene};

use crate::error::ImportError;

mod column;
mod feather;
mod forecast;
mod map;
mod sensor;
mod table;

/// Tables that mark the two kinds of log.
const POSES: &str = "city_SE3_egovehicle";
const SCENARIO: &str = "scenario";
const MAP: &str = "log_map_archive";
/// Files of tables, the ones preferred first.
const TABLES: [&str; 3] = ["feather", "csv", "parquet"];

/// Reads the log of a folder.
///
/// # Errors
/// [`ImportError`] names the file, the column or field, and what is wrong.
pub fn read(folder: &Path) -> Result<(Scene, Vec<Warning>), ImportError> {
    let mut notes = Vec::new();
    let scene = if let Some(poses) = find(folder, &["."], POSES, &TABLES) {
        sensor::scene(folder, &poses, &mut notes)?
    } else if let Some(table) = find(folder, &["."], SCENARIO, &TABLES) {
        forecast::scene(folder, &table, &mut notes)?
    } else {
        return Err(missing(folder, format!("{POSES} or {SCENARIO}*"), &TABLES));
    };
    notes.extend(warnings(&scene));
    Ok((scene, notes))
}

/// Says whether a folder holds a log.
pub(super) fn is_log(folder: &Path) -> bool {
    let has = |stem, extensions: &[&str]| find(folder, &["."], stem, extensions).is_some();
    has(POSES, &TABLES) || (has(SCENARIO, &TABLES) && has(MAP, &["json"]))
}

/// Returns the file in one of some folders of a log whose name begins with a stem.
fn find(log: &Path, folders: &[&str], stem: &str, extensions: &[&str]) -> Option<PathBuf> {
    let in_folder = |folder: &&str| {
        let entries = std::fs::read_dir(log.join(folder)).into_iter().flatten().flatten().map(|entry| entry.path());
        let mut files: Vec<(usize, PathBuf)> = entries
            .filter(|path| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(stem)))
            .filter_map(|path| {
                Some((extensions.iter().position(|known| path.extension() == Some(known.as_ref()))?, path))
            })
            .collect();
        files.sort();
        files.into_iter().next().map(|(_, path)| path)
    };
    folders.iter().find_map(in_folder)
}

fn missing(log: &Path, file: impl Display, extensions: &[&str]) -> ImportError {
    ImportError::Missing { what: format!("{file}.{}", extensions.join("|")), path: log.to_owned() }
}

/// Reads the map of a log, positions moved by `-origin`.
fn map_of(log: &Path, origin: DVec2, notes: &mut Vec<Warning>) -> Result<(ds_world::Map, PathBuf), ImportError> {
    let path = find(log, &["map", "."], MAP, &["json"]).ok_or_else(|| missing(log, format!("{MAP}*"), &["json"]))?;
    if origin != DVec2::ZERO {
        notes.push(Warning { at: "map".to_owned(), message: format!("all positions are moved by -{origin}") });
    }
    Ok((map::read(&path, origin, notes)?, path))
}

fn origin(source: &str) -> Origin {
    Origin {
        source: format!("Argoverse 2 {source}"),
        licence: "CC-BY-NC-SA-4.0".to_owned(),
        attribution: "Argoverse 2, Argo AI".to_owned(),
    }
}

/// Returns the words for the video model; the city is that of a table or of a map's file name (`…____PIT_city_1.json`).
fn prompt(city: &str) -> String {
    let cities = [
        (["austin", "ATX_city"], "Austin"),
        (["dearborn", "DTW_city"], "Detroit"),
        (["miami", "MIA_city"], "Miami"),
        (["palo-alto", "PAO_city"], "Palo Alto"),
        (["pittsburgh", "PIT_city"], "Pittsburgh"),
        (["washington-dc", "WDC_city"], "Washington, D.C."),
    ];
    let known = cities.iter().find(|(marks, _)| marks.iter().any(|mark| city.contains(mark)));
    known.map_or_else(
        || "front camera view of a city street".to_owned(),
        |(_, name)| format!("front camera view of a street in {name}"),
    )
}

/// Returns the class of a category of annotations or a type of forecasting; `None` for what is no road user.
fn class(category: &str) -> Option<AgentClass> {
    match category.to_ascii_uppercase().as_str() {
        "REGULAR_VEHICLE"
        | "LARGE_VEHICLE"
        | "VEHICLE"
        | "BUS"
        | "SCHOOL_BUS"
        | "ARTICULATED_BUS"
        | "BOX_TRUCK"
        | "TRUCK"
        | "TRUCK_CAB"
        | "VEHICULAR_TRAILER"
        | "RAILED_VEHICLE"
        | "MESSAGE_BOARD_TRAILER"
        | "TRAFFIC_LIGHT_TRAILER" => Some(AgentClass::Vehicle),
        "PEDESTRIAN" | "OFFICIAL_SIGNALER" | "STROLLER" | "WHEELCHAIR" => Some(AgentClass::Pedestrian),
        "BICYCLE" | "BICYCLIST" | "CYCLIST" | "RIDERLESS_BICYCLE" | "MOTORCYCLE" | "MOTORCYCLIST"
        | "WHEELED_DEVICE" | "WHEELED_RIDER" => Some(AgentClass::Cyclist),
        "CONSTRUCTION_CONE" | "CONSTRUCTION_BARREL" | "CONSTRUCTION" => Some(AgentClass::Cone),
        "BOLLARD" | "MOBILE_PEDESTRIAN_SIGN" | "MOBILE_PEDESTRIAN_CROSSING_SIGN" => Some(AgentClass::Barrier),
        _ => None,
    }
}

/// Warns of categories that have no place in a scene.
fn left_out(at: &str, counts: BTreeMap<String, usize>, notes: &mut Vec<Warning>) {
    for (kind, count) in counts {
        notes.push(Warning { at: at.to_owned(), message: format!("{count} of type {kind:?} are left out") });
    }
}

#[cfg(test)]
mod tests;

//! Maps of nuPlan, as OpenScene and NAVSIM use them: `<location>/<version>/map.gpkg`, the part around a drive.
//!
//! The tables of a map, their columns and codes are those that nuplan-devkit (v1.2) reads; `docs/data.md` lists them.
//! Points are projected to the UTM zone that the map names, which is the frame of the log's poses, and moved like the
//! drive. Walkways, the heads of traffic lights and raster layers are not read.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use ds_scenario::Warning;
use ds_space::DVec2;
use ds_world::{LaneId, Map};

use crate::error::ImportError;

mod areas;
mod geometry;
mod lanes;
mod package;
mod signals;
mod utm;

pub use geometry::GeometryError;
pub use package::MapError;

use package::{Package, Row, Window};

/// How far from the drive the map is kept, in metres.
const REACH_M: f64 = 150.0;
/// Places of the drive are kept this far apart, in metres.
const APART_M: f64 = 10.0;
/// The folders that hold maps, in the words of NAVSIM and of nuPlan.
const FOLDERS: [&str; 2] = ["maps", "nuplan-maps-v1.0"];
/// How many folders upwards maps are looked for.
const UPWARDS: usize = 4;

/// A map and what its traffic lights are about.
#[derive(Debug, Default)]
pub(super) struct City {
    pub map: Map,
    connectors: Vec<Connector>,
    stops: Vec<Stop>,
}

/// A way from lane to lane, as traffic lights name it.
#[derive(Debug, Clone)]
struct Connector {
    fid: i64,
    lane: LaneId,
    /// The lane that traffic comes from.
    from: i64,
    /// The stop areas of its traffic lights.
    stops: Vec<i64>,
}

/// An area at which to stop.
#[derive(Debug, Clone)]
struct Stop {
    fid: i64,
    kind: i64,
    area: Vec<DVec2>,
}

/// What a log says of traffic lights at a time: lane connectors, and whether they show red.
pub(super) type SignalReading = (f64, BTreeMap<i64, bool>);

/// Returns the map of a location: in the given folder, or else in a folder of maps in or above the root of the data.
///
/// # Errors
/// If a folder of maps is given and has none, or its list of versions is damaged.
pub(super) fn find(root: &Path, maps: Option<&Path>, location: &str) -> Result<Option<PathBuf>, ImportError> {
    let location = location.trim_end_matches(".gpkg");
    if !is_name(location) {
        return Ok(None);
    }
    if let Some(maps) = maps {
        let folders = std::iter::once(maps.to_owned()).chain(FOLDERS.map(|name| maps.join(name)));
        let missing = || ImportError::Missing { what: format!("{location}/*/map.gpkg"), path: maps.to_owned() };
        return first(folders, location)?.ok_or_else(missing).map(Some);
    }
    let root = std::path::absolute(root).map_err(|source| ImportError::Read { path: root.to_owned(), source })?;
    let folders = root.ancestors().take(UPWARDS).flat_map(|folder| FOLDERS.map(|name| folder.join(name)));
    first(folders, location)
}

fn first(folders: impl Iterator<Item = PathBuf>, location: &str) -> Result<Option<PathBuf>, ImportError> {
    for folder in folders {
        if let Some(found) = version(&folder, location)? {
            return Ok(Some(found));
        }
    }
    Ok(None)
}

/// Says whether a text from outside may be the name of a folder.
fn is_name(text: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    !text.is_empty() && text.len() < 100 && !text.starts_with('.') && text.chars().all(plain)
}

/// Returns the map of a location: of the version that `nuplan-maps-v1.0.json` names, else the newest.
fn version(maps: &Path, location: &str) -> Result<Option<PathBuf>, ImportError> {
    let Ok(entries) = std::fs::read_dir(maps.join(location)) else { return Ok(None) };
    let mut found: Vec<(Vec<u64>, PathBuf)> = Vec::new();
    for path in entries.flatten().map(|entry| entry.path().join("map.gpkg")).filter(|path| path.is_file()) {
        let name = path.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy().into_owned();
        found.push((name.split('.').map(|part| part.parse().unwrap_or(0)).collect(), path));
    }
    found.sort();
    let list = maps.join("nuplan-maps-v1.0.json");
    if list.is_file() {
        let refuse = |at: String, problem: String| ImportError::Field { path: list.clone(), at, problem };
        let versions: serde_json::Value = serde_json::from_slice(&crate::file::bytes(&list)?)
            .map_err(|error| refuse(".".to_owned(), error.to_string()))?;
        if let Some(version) = versions[location]["version"].as_str() {
            if !is_name(version) {
                return Err(refuse(format!("{location}.version"), format!("is {version:?}, which is no folder")));
            }
            let named = maps.join(location).join(version).join("map.gpkg");
            if named.is_file() {
                return Ok(Some(named));
            }
        }
    }
    Ok(found.pop().map(|(_, path)| path))
}

/// Reads the map around places in its UTM zone, all points moved by `-origin`.
///
/// # Errors
/// [`ImportError::Map`] says what is wrong with the map.
pub(super) fn read(
    path: &Path,
    origin: DVec2,
    places: &[DVec2],
    notes: &mut Vec<Warning>,
) -> Result<City, ImportError> {
    let package = Package::open(path);
    let city = package.and_then(|package| Ground::new(&package, origin, places, notes).city(path));
    city.map_err(|source| ImportError::Map { path: path.to_owned(), source })
}

/// Adds the traffic lights with what they show at each tick, and the stop lines.
pub(super) use signals::add as add_signals;

/// The open map, the drive in it, and what is to be said of both.
struct Ground<'a> {
    package: &'a Package,
    origin: DVec2,
    places: Vec<DVec2>,
    window: Window,
    notes: &'a mut Vec<Warning>,
    holes: usize,
}

impl<'a> Ground<'a> {
    fn new(package: &'a Package, origin: DVec2, places: &[DVec2], notes: &'a mut Vec<Warning>) -> Self {
        let low = places.iter().copied().reduce(DVec2::min).unwrap_or(origin) - REACH_M;
        let high = places.iter().copied().reduce(DVec2::max).unwrap_or(origin) + REACH_M;
        let mut apart: Vec<DVec2> = Vec::new();
        for place in places {
            if apart.last().is_none_or(|last| last.distance(*place) > APART_M) {
                apart.push(*place);
            }
        }
        Self { package, origin, places: apart, window: Window { low, high }, notes, holes: 0 }
    }

    fn city(mut self, path: &Path) -> Result<City, MapError> {
        let mut city = lanes::read(&mut self)?;
        areas::read(&mut self, &mut city)?;
        self.tell(path, &city.map);
        Ok(city)
    }

    /// Returns the rows of a layer.
    fn rows(&mut self, layer: &package::Layer) -> Result<Vec<Row>, MapError> {
        let rows = self.package.rows(layer, &self.window)?;
        self.holes += rows.iter().map(|row| row.geometry.holes).sum::<usize>();
        Ok(rows)
    }

    /// Returns the rows of a layer that a map may lack.
    fn rows_if_any(&mut self, layer: &package::Layer) -> Result<Vec<Row>, MapError> {
        if self.package.has(layer)? {
            return self.rows(layer);
        }
        self.note(format!("has no layer {:?}; it is left out", layer.name));
        Ok(Vec::new())
    }

    fn note(&mut self, message: String) {
        self.notes.push(Warning { at: "map".to_owned(), message });
    }

    /// Says whether the box around points comes within reach of the drive.
    fn near(&self, points: &[DVec2]) -> bool {
        let low = points.iter().copied().reduce(DVec2::min);
        let high = points.iter().copied().reduce(DVec2::max);
        let reach_m = REACH_M + APART_M;
        low.zip(high).is_some_and(|(low, high)| {
            self.places.iter().any(|place| place.clamp(low, high).distance_squared(*place) <= reach_m * reach_m)
        })
    }

    /// Returns the longest line of a row near the drive, in the world.
    fn line(&self, row: &Row) -> Option<Vec<DVec2>> {
        let length_m = |line: &[DVec2]| line.windows(2).map(|pair| pair[0].distance(pair[1])).sum::<f64>();
        let line = row.geometry.lines.iter().max_by(|a, b| length_m(a).total_cmp(&length_m(b)))?;
        if !self.near(line) {
            return None;
        }
        let mut line: Vec<DVec2> = line.iter().map(|point| *point - self.origin).collect();
        line.dedup_by(|a, b| a.distance(*b) < 1e-3);
        (line.len() > 1).then_some(line)
    }

    /// Returns the outlines of a row near the drive, in the world, without the repetition of their first points.
    fn outlines(&self, row: &Row) -> Vec<Vec<DVec2>> {
        let near = row.geometry.rings.iter().filter(|ring| self.near(ring));
        near.map(|ring| self.outline(ring)).filter(|ring| ring.len() > 2).collect()
    }

    fn outline(&self, ring: &[DVec2]) -> Vec<DVec2> {
        let mut ring: Vec<DVec2> = ring.iter().map(|point| *point - self.origin).collect();
        ring.dedup_by(|a, b| a.distance(*b) < 1e-3);
        // Points that say nothing cost time wherever an area is cut into triangles.
        let mut ring = ds_space::plane::path::thin(&ring, 0.01, 50.0);
        while ring.len() > 1 && ring[0].distance(ring[ring.len() - 1]) < 1e-3 {
            ring.pop();
        }
        ring
    }

    fn tell(&mut self, path: &Path, map: &Map) {
        if self.holes > 0 {
            let message = format!("{} holes of areas are taken as filled", self.holes);
            self.note(message);
        }
        if map.lanes.is_empty() {
            self.note(format!("has no lane within {REACH_M} m of the drive: {}", path.display()));
        }
    }
}

#[cfg(test)]
pub(super) mod tests;

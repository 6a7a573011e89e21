//! A GeoPackage (SQLite) opened for reading: its settings, and the rows of its layers near a place.
//!
//! The file comes from outside. It is never written; views, triggers and functions of its schema are off; a layer must
//! be a plain table with the columns that are asked for; rows, points and bytes are bounded. Where a layer has the
//! spatial index of the standard (`rtree_<table>_<column>`) only the rows of the wanted box are read.

use std::cell::Cell;
use std::path::Path;

use ds_space::DVec2;
use rusqlite::config::DbConfig;
use rusqlite::limits::Limit;
use rusqlite::types::{Value, ValueRef};
use rusqlite::{Connection, OpenFlags, OptionalExtension};

use super::geometry::{self, Geometry, GeometryError};
use super::utm::Zone;

/// The largest geometry or text that is read, in bytes.
const MOST_CELL_BYTES: i32 = 64 << 20;
/// The most rows of a layer that are looked at, and the most that are kept.
const MOST_SCANNED: usize = 5_000_000;
const MOST_ROWS: usize = 100_000;
/// The most points of all rows that are kept.
const MOST_POINTS: usize = 10_000_000;
/// The farthest that a point may lie from the window, in metres.
const FAR_M: f64 = 1e5;
/// The code of longitude and latitude.
const WGS84: i64 = 4_326;

/// Says why a map is refused.
#[derive(Debug, thiserror::Error)]
pub enum MapError {
    /// SQLite refuses the file or a query.
    #[error("cannot {doing}")]
    Sql {
        /// What was being done.
        doing: String,
        /// Why.
        source: rusqlite::Error,
    },
    /// A layer is missing, or is no plain table.
    #[error("map has no layer {layer:?}")]
    NoLayer {
        /// The layer.
        layer: String,
    },
    /// A layer lacks a column.
    #[error("layer {layer:?} has no column {column:?}")]
    NoColumn {
        /// The layer.
        layer: String,
        /// The column.
        column: String,
    },
    /// The table of settings lacks a key.
    #[error("layer \"meta\" has no key {key:?}")]
    NoSetting {
        /// The key.
        key: String,
    },
    /// The map is projected to something else than a UTM zone.
    #[error("projected coordinate system {found:?} is no UTM zone (epsg:326zz or epsg:327zz)")]
    UnknownProjection {
        /// What the map says.
        found: String,
    },
    /// A layer's coordinates are neither longitude and latitude nor the map's UTM zone.
    #[error("layer {layer:?} has the unknown coordinate system {found:?}, not EPSG:4326 or EPSG:{zone}")]
    UnknownSrs {
        /// The layer.
        layer: String,
        /// What the layer says.
        found: String,
        /// The map's zone.
        zone: u32,
    },
    /// A geometry is damaged.
    #[error("layer {layer:?}, row {fid} is damaged")]
    Geometry {
        /// The layer.
        layer: String,
        /// The row.
        fid: i64,
        /// Why.
        source: GeometryError,
    },
    /// A row holds something else than its column should.
    #[error("layer {layer:?}, row {fid}: {problem}")]
    Row {
        /// The layer.
        layer: String,
        /// The row.
        fid: i64,
        /// What is wrong.
        problem: String,
    },
    /// There is too much near the drive.
    #[error("layer {layer:?} has more than {limit} {what}")]
    TooLarge {
        /// The layer.
        layer: String,
        /// What there is too much of.
        what: &'static str,
        /// The limit.
        limit: usize,
    },
}

fn sql(doing: impl Into<String>) -> impl FnOnce(rusqlite::Error) -> MapError {
    move |source| MapError::Sql { doing: doing.into(), source }
}

/// What is asked of a layer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Layer {
    pub name: &'static str,
    /// Columns that must be there.
    pub columns: &'static [&'static str],
    /// Columns that may be missing; they are then empty.
    pub extra: &'static [&'static str],
}

/// A row of a layer: its values in the order of the columns, the extra ones last.
#[derive(Debug, Clone)]
pub(super) struct Row {
    pub fid: i64,
    pub geometry: Geometry,
    values: Vec<Value>,
}

impl Row {
    /// Returns a whole number, also where it is stored as a real or as text.
    pub(super) fn integer(&self, column: usize) -> Option<i64> {
        match self.values.get(column)? {
            Value::Integer(value) => Some(*value),
            #[expect(clippy::cast_possible_truncation, reason = "whole and bounded")]
            Value::Real(value) if value.fract() == 0.0 && value.abs() < 9e15 => Some(*value as i64),
            Value::Text(text) => text.trim().parse().ok(),
            _ => None,
        }
    }

    /// Returns a finite number.
    pub(super) fn real(&self, column: usize) -> Option<f64> {
        match self.values.get(column)? {
            #[expect(clippy::cast_precision_loss, reason = "a measure, not an id")]
            Value::Integer(value) => Some(*value as f64),
            Value::Real(value) => Some(*value).filter(|value| value.is_finite()),
            Value::Text(text) => text.trim().parse().ok().filter(|value: &f64| value.is_finite()),
            _ => None,
        }
    }

    /// Returns whole numbers set apart by commas.
    pub(super) fn integers(&self, column: usize) -> Vec<i64> {
        match self.values.get(column) {
            Some(Value::Text(text)) => text.split(',').filter_map(|part| part.trim().parse().ok()).collect(),
            _ => self.integer(column).into_iter().collect(),
        }
    }
}

/// A box in the plane of the map's zone.
#[derive(Debug, Clone, Copy)]
pub(super) struct Window {
    pub low: DVec2,
    pub high: DVec2,
}

/// An open map.
pub(super) struct Package {
    connection: Connection,
    zone: Zone,
    points: Cell<usize>,
}

impl Package {
    /// Opens a map and reads which zone it is projected to.
    pub(super) fn open(path: &Path) -> Result<Self, MapError> {
        let doing = || format!("open {}", path.display());
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(path, flags).map_err(sql(doing()))?;
        for (config, value) in [
            (DbConfig::SQLITE_DBCONFIG_DEFENSIVE, true),
            (DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false),
            (DbConfig::SQLITE_DBCONFIG_ENABLE_VIEW, false),
            (DbConfig::SQLITE_DBCONFIG_ENABLE_TRIGGER, false),
        ] {
            connection.set_db_config(config, value).map_err(sql(doing()))?;
        }
        connection.set_limit(Limit::SQLITE_LIMIT_LENGTH, MOST_CELL_BYTES).map_err(sql(doing()))?;
        connection.pragma_update(None, "cell_size_check", true).map_err(sql(doing()))?;
        let zone = zone(&connection)?;
        Ok(Self { connection, zone, points: Cell::new(0) })
    }

    /// Says whether there is a layer.
    pub(super) fn has(&self, layer: &Layer) -> Result<bool, MapError> {
        is_table(&self.connection, layer.name)
    }

    /// Returns the rows of a layer that may touch a window, in order of their numbers, points in the map's zone.
    pub(super) fn rows(&self, layer: &Layer, window: &Window) -> Result<Vec<Row>, MapError> {
        if !self.has(layer)? {
            return Err(MapError::NoLayer { layer: layer.name.to_owned() });
        }
        let there = columns(&self.connection, layer.name)?;
        let missing = |column: &str| MapError::NoColumn { layer: layer.name.to_owned(), column: column.to_owned() };
        if let Some(column) = std::iter::once(&"fid").chain(layer.columns).find(|column| !holds(&there, column)) {
            return Err(missing(column));
        }
        let (geometry, projected) = self.geometry_column(layer)?;
        if !holds(&there, &geometry) {
            return Err(missing(&geometry));
        }
        let extra = layer.extra.iter().map(|column| if holds(&there, column) { quoted(column) } else { "NULL".into() });
        let values: Vec<String> = layer.columns.iter().map(|column| quoted(column)).chain(extra).collect();
        let index = format!("rtree_{}_{geometry}", layer.name);
        let indexed = is_spatial_index(&self.connection, &index)?;
        let near = if indexed {
            let index = quoted(&index);
            format!(
                "WHERE \"fid\" IN \
                 (SELECT id FROM {index} WHERE maxx >= ?1 AND minx <= ?2 AND maxy >= ?3 AND miny <= ?4)"
            )
        } else {
            String::new()
        };
        let mut parts = vec!["\"fid\"".to_owned(), quoted(&geometry)];
        parts.extend(values);
        let query = format!("SELECT {} FROM {} {near} ORDER BY \"fid\"", parts.join(", "), quoted(layer.name));
        self.read(layer, &query, indexed, &self.patch(window, projected))
    }

    /// Runs the query of a layer and keeps the rows that touch a patch.
    fn read(&self, layer: &Layer, query: &str, indexed: bool, patch: &Patch) -> Result<Vec<Row>, MapError> {
        let doing = || format!("read layer {:?}", layer.name);
        let too_large = |what, limit| MapError::TooLarge { layer: layer.name.to_owned(), what, limit };
        let mut statement = self.connection.prepare(query).map_err(sql(doing()))?;
        let bounds = [patch.low.x, patch.high.x, patch.low.y, patch.high.y];
        let bounds = bounds.iter().take(if indexed { 4 } else { 0 });
        let mut found = statement.query(rusqlite::params_from_iter(bounds)).map_err(sql(doing()))?;
        let (mut rows, mut scanned) = (Vec::new(), 0);
        while let Some(row) = found.next().map_err(sql(doing()))? {
            scanned += 1;
            if scanned > MOST_SCANNED {
                return Err(too_large("rows", MOST_SCANNED));
            }
            let fid: i64 = row.get(0).map_err(sql(doing()))?;
            let blob = match row.get_ref(1).map_err(sql(doing()))? {
                ValueRef::Blob(blob) => blob,
                // A row without a place is nowhere near.
                ValueRef::Null => continue,
                _ => {
                    let problem = "its geometry is no blob".to_owned();
                    return Err(MapError::Row { layer: layer.name.to_owned(), fid, problem });
                }
            };
            let damaged = |source| MapError::Geometry { layer: layer.name.to_owned(), fid, source };
            let mut geometry = geometry::read(blob).map_err(damaged)?;
            if !patch.touches(&geometry) {
                continue;
            }
            let outside = |point: DVec2| {
                let problem = format!("{point} lies more than {FAR_M} m from the drive");
                MapError::Row { layer: layer.name.to_owned(), fid, problem }
            };
            for point in geometry.all_mut() {
                *point = patch.plane(*point).ok_or_else(|| outside(*point))?;
            }
            self.points.set(self.points.get() + geometry.all().count());
            if rows.len() >= MOST_ROWS {
                return Err(too_large("rows near the drive", MOST_ROWS));
            }
            if self.points.get() > MOST_POINTS {
                return Err(too_large("points near the drive", MOST_POINTS));
            }
            let count = layer.columns.len() + layer.extra.len();
            let value = |column: usize| row.get(column).map_err(sql(doing()));
            let values = (2..2 + count).map(value).collect::<Result<_, _>>()?;
            rows.push(Row { fid, geometry, values });
        }
        Ok(rows)
    }

    /// Returns a layer's column of geometries, and whether they are in the map's zone already.
    fn geometry_column(&self, layer: &Layer) -> Result<(String, bool), MapError> {
        let doing = || format!("read the coordinate system of layer {:?}", layer.name);
        let found: Option<(String, i64)> = self
            .connection
            .query_row(
                "SELECT column_name, srs_id FROM gpkg_geometry_columns WHERE table_name = ?1",
                [layer.name],
                |row| Ok((row.get(0)?, row.get(1)?)),
            )
            .optional()
            .map_err(sql(doing()))?;
        let Some((column, srs)) = found else {
            return Err(MapError::NoColumn { layer: layer.name.to_owned(), column: "geometry".to_owned() });
        };
        let system: Option<(String, i64)> = self
            .connection
            .query_row(
                "SELECT organization, organization_coordsys_id FROM gpkg_spatial_ref_sys WHERE srs_id = ?1",
                [srs],
                |row| Ok((row.get(0)?, row.get(1)?)),
            )
            .optional()
            .map_err(sql(doing()))?;
        match &system {
            Some((owner, WGS84)) if owner.eq_ignore_ascii_case("epsg") => Ok((column, false)),
            Some((owner, code)) if owner.eq_ignore_ascii_case("epsg") && *code == i64::from(self.zone.code()) => {
                Ok((column, true))
            }
            _ => {
                let found = system.map_or_else(|| srs.to_string(), |(owner, code)| format!("{owner}:{code}"));
                Err(MapError::UnknownSrs { layer: layer.name.to_owned(), found, zone: self.zone.code() })
            }
        }
    }

    /// Returns a window in the units of a layer, in degrees somewhat widened: its sides are curves there.
    fn patch(&self, window: &Window, projected: bool) -> Patch {
        const WIDER_DEG: f64 = 5e-4;
        if projected {
            return Patch { low: window.low, high: window.high, zone: None, window: *window };
        }
        let middle = window.low.midpoint(window.high);
        let (xs, ys) = ([window.low.x, middle.x, window.high.x], [window.low.y, middle.y, window.high.y]);
        let places = || xs.iter().flat_map(|x| ys.iter().map(|y| self.zone.degrees(DVec2::new(*x, *y))));
        Patch {
            low: places().reduce(DVec2::min).unwrap_or_default() - WIDER_DEG,
            high: places().reduce(DVec2::max).unwrap_or_default() + WIDER_DEG,
            zone: Some(self.zone),
            window: *window,
        }
    }
}

/// A window in the units of a layer, and the zone to project them to unless they are in it already.
struct Patch {
    low: DVec2,
    high: DVec2,
    zone: Option<Zone>,
    window: Window,
}

impl Patch {
    /// Says whether the box around a geometry touches the window.
    fn touches(&self, geometry: &Geometry) -> bool {
        let low = geometry.all().copied().reduce(DVec2::min);
        let high = geometry.all().copied().reduce(DVec2::max);
        let touches = |(low, high): (DVec2, DVec2)| low.cmple(self.high).all() && high.cmpge(self.low).all();
        low.zip(high).is_some_and(touches)
    }

    /// Returns a point in the plane of the zone; `None` if it lies far from the window.
    fn plane(&self, point: DVec2) -> Option<DVec2> {
        let Window { low, high } = self.window;
        let plane = self.zone.map_or(Some(point), |zone| zone.plane(point));
        plane.filter(|plane| plane.cmpge(low - FAR_M).all() && plane.cmple(high + FAR_M).all())
    }
}

fn holds(columns: &[String], wanted: &str) -> bool {
    columns.iter().any(|column| column == wanted)
}

fn quoted(name: &str) -> String {
    format!("\"{}\"", name.replace('"', "\"\""))
}

/// Returns the statement that made a table, if there is one of that name.
fn statement(connection: &Connection, name: &str) -> Result<Option<String>, MapError> {
    let query = "SELECT sql FROM sqlite_master WHERE type = 'table' AND name = ?1";
    let found = connection.query_row(query, [name], |row| row.get::<_, Option<String>>(0)).optional();
    Ok(found.map_err(sql("read the list of tables"))?.flatten().map(|made| made.to_ascii_uppercase()))
}

fn is_table(connection: &Connection, name: &str) -> Result<bool, MapError> {
    Ok(statement(connection, name)?.is_some_and(|made| made.trim_start().starts_with("CREATE TABLE")))
}

fn is_spatial_index(connection: &Connection, name: &str) -> Result<bool, MapError> {
    let made = statement(connection, name)?;
    Ok(made.is_some_and(|made| made.trim_start().starts_with("CREATE VIRTUAL TABLE") && made.contains("USING RTREE")))
}

fn columns(connection: &Connection, table: &str) -> Result<Vec<String>, MapError> {
    let doing = || format!("list the columns of {table:?}");
    let mut statement = connection.prepare("SELECT name FROM pragma_table_info(?1)").map_err(sql(doing()))?;
    let names = statement.query_map([table], |row| row.get(0)).map_err(sql(doing()))?;
    names.collect::<Result<_, _>>().map_err(sql(doing()))
}

/// Reads the zone from the table of settings.
fn zone(connection: &Connection) -> Result<Zone, MapError> {
    const KEY: &str = "projectedCoordSystem";
    if !is_table(connection, "meta")? {
        return Err(MapError::NoLayer { layer: "meta".to_owned() });
    }
    let there = columns(connection, "meta")?;
    if let Some(column) = ["key", "value"].into_iter().find(|column| !holds(&there, column)) {
        return Err(MapError::NoColumn { layer: "meta".to_owned(), column: column.to_owned() });
    }
    let found: Option<Option<String>> = connection
        .query_row("SELECT CAST(\"value\" AS TEXT) FROM \"meta\" WHERE \"key\" = ?1", [KEY], |row| row.get(0))
        .optional()
        .map_err(sql("read the settings"))?;
    let found = found.flatten().ok_or_else(|| MapError::NoSetting { key: KEY.to_owned() })?;
    let code = found.trim().to_ascii_lowercase();
    let code = code.strip_prefix("epsg:").and_then(|code| code.parse().ok()).and_then(Zone::of);
    code.ok_or(MapError::UnknownProjection { found })
}

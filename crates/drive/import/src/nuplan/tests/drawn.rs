//! Draws a small map with the tables and columns of nuPlan's, in degrees, as a GeoPackage.
//!
//! Everything is given in metres east and north of a place in Boston's zone. Some layers have a spatial index, others
//! have none.

use std::path::Path;

use ds_space::DVec2;
use rusqlite::types::Value;
use rusqlite::{Connection, params_from_iter};

use crate::nuplan::utm::Zone;

/// The EPSG code of the zone, and the place in it that the drawing is about.
pub(crate) const CODE: u32 = 32_619;
pub(crate) const BASE: DVec2 = DVec2::new(330_000.0, 4_690_000.0);
pub(crate) const LOCATION: &str = "us-ma-boston";

/// Tables, their columns as in nuPlan's maps (types of SQLite), whether they have a spatial index here.
const TABLES: [(&str, &str, bool); 13] = [
    (
        "lanes_polygons",
        "lane_group_fid INTEGER, lane_fid INTEGER, lane_index MEDIUMINT, lane_type_fid INTEGER, \
         left_boundary_fid INTEGER, right_boundary_fid INTEGER, speed_limit_mps REAL, \
         from_edge_fid INTEGER, to_edge_fid INTEGER",
        true,
    ),
    ("baseline_paths", "path_type_fid INTEGER, lane_fid INTEGER, lane_connector_fid INTEGER", true),
    (
        "lane_connectors",
        "exit_lane_fid INTEGER, entry_lane_fid INTEGER, intersection_fid INTEGER, turn_type_fid INTEGER, \
         traffic_light_stop_line_fids TEXT(256), speed_limit_mps REAL",
        false,
    ),
    (
        "gen_lane_connectors_scaled_width_polygons",
        "lane_connector_fid INTEGER, left_boundary_fid INTEGER, right_boundary_fid INTEGER",
        false,
    ),
    ("boundaries", "boundary_segment_fids TEXT(256), has_reflectors BOOLEAN, boundary_type_fid INTEGER", false),
    ("intersections", "intersection_type_fid INTEGER, is_mini BOOLEAN", false),
    ("crosswalks", "intersection_fids TEXT(256), lane_fids TEXT(256), is_marked BOOLEAN", false),
    ("stop_polygons", "stop_polygon_type_fid INTEGER, lane_fids TEXT(256), traffic_light_fids TEXT(256)", false),
    ("road_segments", "lane_group_fids TEXT(256)", false),
    ("lane_groups_polygons", "left_boundary_fid INTEGER, right_boundary_fid INTEGER", false),
    ("generic_drivable_areas", "creator_id TEXT(256)", false),
    ("carpark_areas", "heading REAL", false),
    ("walkways", "creator_id TEXT(256)", false),
];

/// A shape in metres about [`BASE`].
pub(crate) enum Shape<'a> {
    Line(&'a [(f64, f64)]),
    /// An outline, its first point not repeated.
    Area(&'a [(f64, f64)]),
}

/// Returns a shape as a geometry of a GeoPackage, little-endian, without an envelope.
pub(crate) fn blob(shape: &Shape<'_>) -> Vec<u8> {
    let zone = Zone::of(CODE).expect("a zone");
    let mut bytes = b"GP\0\x01".to_vec();
    bytes.extend(4_326i32.to_le_bytes());
    let (kind, mut points) = match shape {
        Shape::Line(points) => (2u32, points.to_vec()),
        Shape::Area(points) => (3u32, points.to_vec()),
    };
    bytes.push(1);
    bytes.extend(kind.to_le_bytes());
    if kind == 3 {
        bytes.extend(1u32.to_le_bytes());
        points.push(points[0]);
    }
    bytes.extend((points.len() as u32).to_le_bytes());
    for (x, y) in points {
        let degrees = zone.degrees(BASE + DVec2::new(x, y));
        bytes.extend(degrees.x.to_le_bytes());
        bytes.extend(degrees.y.to_le_bytes());
    }
    bytes
}

struct Sheet(Connection);

impl Sheet {
    fn new(path: &Path) -> Self {
        let sheet = Self(Connection::open(path).expect("opens"));
        sheet.run(
            "PRAGMA synchronous = OFF; PRAGMA page_size = 512;
             PRAGMA application_id = 0x47504B47; PRAGMA user_version = 10300;
             CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT NOT NULL, srs_id INTEGER NOT NULL PRIMARY KEY,
                 organization TEXT NOT NULL, organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL);
             INSERT INTO gpkg_spatial_ref_sys VALUES ('WGS 84', 4326, 'EPSG', 4326, 'undefined'),
                 ('none', 0, 'NONE', 0, 'undefined');
             CREATE TABLE gpkg_geometry_columns (table_name TEXT NOT NULL, column_name TEXT NOT NULL,
                 geometry_type_name TEXT NOT NULL, srs_id INTEGER NOT NULL, z TINYINT NOT NULL, m TINYINT NOT NULL);
             CREATE TABLE meta (fid INTEGER PRIMARY KEY, key TEXT, value TEXT);
             INSERT INTO meta (key, value) VALUES ('geographicCoordSystem', 'epsg:4326'),
                 ('projectedCoordSystem', 'epsg:32619');",
        );
        for (name, columns, indexed) in TABLES {
            sheet.run(&format!(
                "CREATE TABLE \"{name}\" (\"fid\" INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, \"geom\" BLOB, {columns});
                 INSERT INTO gpkg_geometry_columns VALUES ('{name}', 'geom', 'GEOMETRY', 4326, 0, 0);"
            ));
            if indexed {
                sheet.run(&format!(
                    "CREATE VIRTUAL TABLE \"rtree_{name}_geom\" USING rtree(id, minx, maxx, miny, maxy);"
                ));
            }
        }
        sheet
    }

    fn run(&self, sql: &str) {
        self.0.execute_batch(sql).expect("the statement runs");
    }

    /// Adds a row with some columns, in the index too where the layer has one.
    fn add(&self, table: &str, fid: i64, shape: &Shape<'_>, values: &[(&str, Value)]) {
        let names: Vec<&str> = ["fid", "geom"].into_iter().chain(values.iter().map(|(name, _)| *name)).collect();
        let blob = blob(shape);
        let marks = vec!["?"; names.len()].join(", ");
        let all = [Value::Integer(fid), Value::Blob(blob.clone())].into_iter();
        let all = all.chain(values.iter().map(|(_, value)| value.clone()));
        let insert = format!("INSERT INTO \"{table}\" ({}) VALUES ({marks})", names.join(", "));
        self.0.execute(&insert, params_from_iter(all)).expect("the row goes in");
        if TABLES.iter().any(|(name, _, indexed)| *name == table && *indexed) {
            let geometry = crate::nuplan::geometry::read(&blob).expect("it is whole");
            let low = geometry.all().copied().reduce(DVec2::min).expect("points");
            let high = geometry.all().copied().reduce(DVec2::max).expect("points");
            let insert = format!("INSERT INTO \"rtree_{table}_geom\" VALUES (?, ?, ?, ?, ?)");
            let bounds = [low.x, high.x, low.y, high.y].map(Value::Real);
            let row = std::iter::once(Value::Integer(fid)).chain(bounds);
            self.0.execute(&insert, params_from_iter(row)).expect("the box goes in");
        }
    }

    fn line(&self, table: &str, fid: i64, points: &[(f64, f64)], values: &[(&str, i64)]) {
        self.add(table, fid, &Shape::Line(points), &whole(values));
    }

    /// Adds an upright box from one corner to the other.
    fn area(&self, table: &str, fid: i64, bounds: [f64; 4], values: &[(&str, i64)]) {
        let [west, south, east, north] = bounds;
        let corners = [(west, south), (east, south), (east, north), (west, north)];
        self.add(table, fid, &Shape::Area(&corners), &whole(values));
    }

    fn set(&self, table: &str, fid: i64, column: &str, value: impl rusqlite::ToSql) {
        let update = format!("UPDATE \"{table}\" SET {column} = ?1 WHERE fid = ?2");
        self.0.execute(&update, rusqlite::params![value, fid]).expect("the row changes");
    }
}

fn whole<'a>(values: &[(&'a str, i64)]) -> Vec<(&'a str, Value)> {
    values.iter().map(|(name, value)| (*name, Value::Integer(*value))).collect()
}

/// Writes the map: two lanes eastwards, one westwards, a bicycle lane, a junction with a way on and one to the north.
pub(crate) fn map(path: &Path) {
    let sheet = Sheet::new(path);
    sheet.run("BEGIN");
    let lane = |fid, bounds, (left, right), kind, line: &[(f64, f64)]| {
        let values =
            [("lane_fid", fid), ("lane_type_fid", kind), ("left_boundary_fid", left), ("right_boundary_fid", right)];
        sheet.area("lanes_polygons", fid, bounds, &values);
        sheet.line("baseline_paths", 1_000 + fid, line, &[("lane_fid", fid)]);
    };
    lane(101, [0.0, -3.5, 100.0, 0.0], (11, 12), 0, &[(0.0, -1.75), (50.0, -1.75), (100.0, -1.75)]);
    lane(102, [0.0, 0.0, 100.0, 3.5], (13, 11), 0, &[(0.0, 1.75), (100.0, 1.75)]);
    lane(103, [120.0, -3.5, 200.0, 0.0], (14, 15), 0, &[(120.0, -1.75), (200.0, -1.75)]);
    lane(104, [116.25, 30.0, 119.75, 80.0], (18, 17), 0, &[(118.0, 30.0), (118.0, 80.0)]);
    lane(105, [0.0, 3.5, 100.0, 7.0], (13, 16), 0, &[(100.0, 5.25), (0.0, 5.25)]);
    lane(106, [0.0, -5.5, 100.0, -3.5], (12, 19), 1, &[(0.0, -4.5), (100.0, -4.5)]);
    lane(999, [5_000.0, 0.0, 5_100.0, 3.5], (98, 99), 0, &[(5_000.0, 1.75), (5_100.0, 1.75)]);
    sheet.set("lanes_polygons", 101, "speed_limit_mps", 11.18);
    // What lies far off is not read: this row is damaged.
    sheet.set("lanes_polygons", 999, "geom", &b"GP"[..]);
    let connector = |fid, from, to, stops: &str, line: &[(f64, f64)]| {
        sheet.line(
            "lane_connectors",
            fid,
            line,
            &[("exit_lane_fid", from), ("entry_lane_fid", to), ("intersection_fid", 301)],
        );
        sheet.set("lane_connectors", fid, "traffic_light_stop_line_fids", stops);
        sheet.line("baseline_paths", 1_000 + fid, line, &[("lane_connector_fid", fid)]);
    };
    connector(201, 101, 103, "501", &[(100.0, -1.75), (120.0, -1.75)]);
    connector(202, 102, 104, "502, ", &[(100.0, 1.75), (110.0, 4.0), (116.0, 12.0), (118.0, 30.0)]);
    connector(203, 101, 104, "501", &[(100.0, -1.75), (112.0, 3.0), (118.0, 30.0)]);
    sheet.area(
        "gen_lane_connectors_scaled_width_polygons",
        1,
        [100.0, -3.5, 120.0, 0.0],
        &[("lane_connector_fid", 201)],
    );
    let boundary = |fid, kind, line: &[(f64, f64)]| sheet.line("boundaries", fid, line, &[("boundary_type_fid", kind)]);
    boundary(11, 0, &[(0.0, 0.0), (100.0, 0.0)]);
    boundary(12, 2, &[(0.0, -3.5), (100.0, -3.5)]);
    boundary(13, 2, &[(0.0, 3.5), (100.0, 3.5)]);
    boundary(16, 2, &[(100.0, 7.0), (0.0, 7.0)]);
    boundary(20, 3, &[(100.0, -1.0), (120.0, -1.0)]);
    sheet.area("intersections", 301, [100.0, -3.5, 120.0, 30.0], &[("intersection_type_fid", 1)]);
    sheet.area("intersections", 302, [80.0, -3.5, 100.0, 3.5], &[("intersection_type_fid", 5)]);
    sheet.area("crosswalks", 401, [96.0, -3.5, 99.0, 7.0], &[("is_marked", 1)]);
    sheet.area("stop_polygons", 501, [94.0, -3.5, 94.5, 0.0], &[("stop_polygon_type_fid", 2)]);
    sheet.area("stop_polygons", 502, [94.0, 0.0, 94.5, 3.5], &[("stop_polygon_type_fid", 2)]);
    sheet.area("stop_polygons", 503, [116.25, 79.0, 119.75, 79.5], &[("stop_polygon_type_fid", 1)]);
    sheet.area("stop_polygons", 504, [95.0, -3.5, 95.5, 7.0], &[("stop_polygon_type_fid", 0)]);
    sheet.area("road_segments", 601, [0.0, -5.5, 100.0, 7.0], &[]);
    sheet.area("carpark_areas", 701, [20.0, -15.0, 40.0, -5.5], &[]);
    sheet.run("COMMIT");
}

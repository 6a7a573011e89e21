//! Maps: a drawn one on which a drive of OpenScene is laid, the folders it may lie in, and spoiled ones.

use std::error::Error as _;
use std::fmt::Write as _;

use ds_space::Tick;
use ds_world::{Lane, LaneKind, LightState, LineKind, Scene, StopLine};
use rusqlite::Connection;

use super::*;
use crate::format::{Format, import_path};
use crate::openscene;
use crate::writer::Writer;
use drawn::{BASE, LOCATION};

mod drawn;

/// A map as the tests draw it, for tests that cannot.
const COMMITTED: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/nuplan-map.gpkg");
const VERSION: &str = "9.12.1817";

/// Writes a log of nine frames: along lane 101 at 8 m/s; connector 201 goes from red to green, 202 stays red.
fn log(location: Option<&str>) -> Vec<u8> {
    let mut w = Writer::new();
    w.list(|w| {
        for k in 0..9 {
            w.dict(|w| {
                w.text("log_name").text("2021.boston").text("timestamp").int(1_000_000 + 500_000 * k);
                if let Some(location) = location {
                    w.text("map_location").text(location);
                }
                let place = [BASE.x + 10.0 + 4.0 * f64::from(k), BASE.y - 1.75, 3.0];
                w.text("ego2global_translation").array(&[3], &place);
                w.text("ego2global_rotation").array(&[4], &[1.0, 0.0, 0.0, 0.0]);
                w.text("lidar2ego_translation").array(&[3], &[0.0; 3]);
                w.text("lidar2ego_rotation").array(&[4], &[1.0, 0.0, 0.0, 0.0]);
                w.text("traffic_lights").list(|w| {
                    w.list(|w| _ = w.int(201).int(i32::from(k < 4)));
                    w.list(|w| _ = w.int(202).int(1));
                });
                w.text("cams").dict(|w| {
                    w.text("CAM_F0").dict(|w| {
                        w.text("cam_intrinsic")
                            .array(&[3, 3], &[1545.0, 0.0, 960.0, 0.0, 1545.0, 560.0, 0.0, 0.0, 1.0]);
                        w.text("sensor2lidar_rotation")
                            .array(&[3, 3], &[0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0]);
                        w.text("sensor2lidar_translation").array(&[3], &[1.6, 0.0, 1.5]);
                    });
                });
            });
        }
    });
    w.done()
}

/// A data set of one log, with the drawn map in `maps` where wanted.
struct Data(tempfile::TempDir);

impl Data {
    fn new(location: Option<&str>) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let data = Self(folder);
        std::fs::create_dir_all(data.root().join("navsim_logs/mini")).expect("makes");
        std::fs::write(data.log(), log(location)).expect("writes");
        data
    }

    fn mapped() -> Self {
        let data = Self::new(Some(LOCATION));
        data.draw(&data.root().join("maps"), VERSION);
        data
    }

    fn root(&self) -> PathBuf {
        self.0.path().join("dataset")
    }

    fn log(&self) -> PathBuf {
        self.root().join("navsim_logs/mini/2021.boston.pkl")
    }

    fn map(&self) -> PathBuf {
        self.root().join("maps").join(LOCATION).join(VERSION).join("map.gpkg")
    }

    fn draw(&self, maps: &Path, version: &str) {
        let folder = maps.join(LOCATION).join(version);
        std::fs::create_dir_all(&folder).expect("makes");
        drawn::map(&folder.join("map.gpkg"));
    }

    fn scene(&self) -> Result<(Scene, Vec<Warning>), ImportError> {
        openscene::scene(&self.root(), &self.log(), None)
    }
}

fn said(warnings: &[Warning]) -> String {
    warnings.iter().map(|warning| format!("{warning}\n")).collect()
}

fn chain(error: &ImportError) -> String {
    let mut text = error.to_string();
    let mut source = error.source();
    while let Some(error) = source {
        write!(text, ": {error}").expect("writing to a string succeeds");
        source = error.source();
    }
    text
}

fn lane<'a>(scene: &'a Scene, name: &str) -> &'a Lane {
    scene.map.lanes.iter().find(|lane| lane.name == name).unwrap_or_else(|| panic!("{name} is imported"))
}

fn names<'a>(scene: &'a Scene, ids: &[LaneId]) -> Vec<&'a str> {
    ids.iter().map(|id| scene.map.lane(*id).expect("the id is good").name.as_str()).collect()
}

/// Where the drive begins, rounded down to whole metres, is the origin: this far from the place that is drawn about.
const MOVED: DVec2 = DVec2::new(10.0, -2.0);

#[test]
fn lanes_lie_where_they_were_drawn_and_are_connected() {
    let (scene, warnings) = Data::mapped().scene().expect("it imports");
    let map = &scene.map;
    assert_eq!(map.lanes.len(), 9, "{:?}", map.lanes.iter().map(|lane| &lane.name).collect::<Vec<_>>());
    let first = lane(&scene, "lane-101");
    let drawn = [DVec2::new(0.0, -1.75) - MOVED, DVec2::new(100.0, -1.75) - MOVED];
    let ends = [first.centre_line[0], first.centre_line[first.centre_line.len() - 1]];
    assert!(ends.iter().zip(drawn).all(|(end, drawn)| end.distance(drawn) < 1e-6), "{ends:?}");
    let corner = DVec2::new(0.0, -3.5) - MOVED;
    assert!(first.polygon.len() == 4 && first.polygon[0].distance(corner) < 1e-6, "{:?}", first.polygon);
    assert_eq!((first.kind, first.speed_limit_mps), (LaneKind::Road, Some(11.18)));
    assert_eq!(lane(&scene, "lane-102").speed_limit_mps, None);
    assert_eq!(names(&scene, &first.successors), ["connector-201", "connector-203"]);
    let on = lane(&scene, "connector-201");
    assert_eq!((on.kind, on.polygon.len()), (LaneKind::Connector, 4));
    assert_eq!((names(&scene, &on.predecessors), names(&scene, &on.successors)), (vec!["lane-101"], vec!["lane-103"]));
    assert_eq!(names(&scene, &lane(&scene, "lane-104").predecessors), ["connector-202", "connector-203"]);
    // Neighbours are of one direction; a bicycle lane is nobody's.
    let beside = |name| {
        let lane = lane(&scene, name);
        [lane.left, lane.right].map(|id| id.map(|id| scene.map.lane(id).expect("the id is good").name.as_str()))
    };
    assert_eq!(beside("lane-101"), [Some("lane-102"), None]);
    assert_eq!(beside("lane-102"), [None, Some("lane-101")]);
    assert_eq!((beside("lane-105"), beside("lane-106")), ([None, None], [None, None]));
    // The drive is on its lane, and goes on along it.
    let ego = scene.logged_ego(Tick(10)).pose.position;
    assert!((ego - (DVec2::new(18.0, -1.75) - MOVED)).length() < 1e-6, "{ego}");
    assert!(scene.route.last().is_some_and(|end| end.x > 90.0), "{:?}", scene.route.last());
    assert!((scene.dt.secs() - 0.1).abs() < 1e-9 && scene.last_tick() == Tick(40));
    let said = said(&warnings);
    assert!(said.contains("moved by -[330010, 4689998]") && !said.contains("off the drivable area"), "{said}");
}

#[test]
fn areas_lines_and_signals_come_with_the_lanes() {
    let (scene, _) = Data::mapped().scene().expect("it imports");
    let map = &scene.map;
    assert_eq!((map.junctions.len(), map.crosswalks.len(), map.drivable.len()), (1, 1, 13));
    let marks: Vec<(LineKind, f64)> =
        map.line_markings.iter().map(|line| (line.kind, (2.0 * (line.points[0] + MOVED).y).round() / 2.0)).collect();
    // Dashed between two lanes; solid towards the bicycle lane and between the directions; the rims are not painted.
    assert_eq!(marks, [(LineKind::Dashed, 0.0), (LineKind::Solid, -3.5), (LineKind::Solid, 3.5)]);
    let rim = |y: f64| {
        let points = map.road_edges.iter().flat_map(|edge| &edge.points).map(|point| *point + MOVED);
        points.filter(|point| (point.y - y).abs() < 1e-3 && (5.0..95.0).contains(&point.x)).count()
    };
    assert!(rim(7.0) > 0 && rim(-15.0) > 0 && rim(-3.5) == 0 && rim(0.0) == 0, "{:?}", map.road_edges);
    // Connectors 201 and 203 begin at one lane and show different things; 202 begins at another.
    let lights: Vec<(Vec<&str>, LightState, LightState)> = map
        .traffic_lights
        .iter()
        .map(|light| (names(&scene, &light.lanes), light.at(Tick(0)), light.at(Tick(40))))
        .collect();
    assert_eq!(
        lights,
        [
            (vec!["connector-203"], LightState::Unknown, LightState::Unknown),
            (vec!["connector-201"], LightState::Red, LightState::Green),
            (vec!["connector-202"], LightState::Red, LightState::Red),
        ]
    );
    let heads: Vec<DVec2> = map.traffic_lights.iter().map(|light| light.position.truncate() + MOVED).collect();
    assert!((heads[0].distance(heads[1]) - 0.8).abs() < 1e-6, "{heads:?}");
    assert!(heads[2].distance(DVec2::new(100.0, 1.75)) < 1e-6 && map.traffic_lights[2].position.z > 4.0);
    let stops: Vec<(Option<u32>, f64)> =
        map.stop_lines.iter().map(|StopLine { points, light }| (*light, points[0].distance(points[1]))).collect();
    assert_eq!(stops.iter().map(|(light, _)| *light).collect::<Vec<_>>(), [Some(0), Some(1), Some(2), None]);
    assert!(stops.iter().all(|(_, length_m)| (3.0..4.0).contains(length_m)), "{stops:?}");
}

#[test]
fn a_drive_without_a_map_says_that_it_has_no_road() {
    let (scene, warnings) = Data::new(Some(LOCATION)).scene().expect("it imports without");
    assert!(scene.map.lanes.is_empty());
    let text = said(&warnings);
    for part in ["there is no us-ma-boston/*/map.gpkg", "the layout will have no road"] {
        assert!(text.contains(part), "{text:?} does not say {part:?}");
    }
    for location in [None, Some("../../etc"), Some("")] {
        let (_, warnings) = Data::new(location).scene().expect("it imports without");
        assert!(said(&warnings).contains("no road"), "{location:?}: {}", said(&warnings));
    }
    // The map of another place is there, but not where the drive is.
    let data = Data::mapped();
    let sheet = Connection::open(data.map()).expect("opens");
    sheet.execute("UPDATE meta SET value = 'epsg:32618' WHERE key = 'projectedCoordSystem'", []).expect("updates");
    let (_, warnings) = data.scene().expect("it imports without");
    assert!(said(&warnings).contains("has no lane within 150 m of the drive"), "{}", said(&warnings));
}

#[test]
fn maps_are_found_by_folder_and_version() {
    let data = Data::new(Some(LOCATION));
    let find = |maps: Option<&Path>| find(&data.root(), maps, "us-ma-boston.gpkg");
    assert_eq!(find(None).expect("looks"), None);
    // Above the root, in nuPlan's own name; the newest version by number.
    let above = data.0.path().join("nuplan-maps-v1.0");
    data.draw(&above, "9.2.5");
    data.draw(&above, "9.12.1817");
    let newest = above.join(LOCATION).join("9.12.1817/map.gpkg");
    assert_eq!(find(None).expect("looks"), Some(newest.clone()));
    std::fs::write(above.join("nuplan-maps-v1.0.json"), r#"{"us-ma-boston": {"version": "9.2.5"}}"#).expect("writes");
    assert_eq!(find(None).expect("looks"), Some(above.join(LOCATION).join("9.2.5/map.gpkg")));
    std::fs::write(above.join("nuplan-maps-v1.0.json"), r#"{"us-ma-boston": {"version": "../x"}}"#).expect("writes");
    assert!(find(None).expect_err("it leads out").to_string().contains("us-ma-boston.version"));
    std::fs::remove_file(above.join("nuplan-maps-v1.0.json")).expect("removes");
    // A folder that is given counts alone.
    let other = data.0.path().join("elsewhere");
    let error = find(Some(&other)).expect_err("it is not there").to_string();
    assert!(error.contains("us-ma-boston/*/map.gpkg") && error.contains("elsewhere"), "{error}");
    data.draw(&other, VERSION);
    assert_eq!(find(Some(&other)).expect("looks"), Some(other.join(LOCATION).join(VERSION).join("map.gpkg")));
    assert_eq!(find(Some(data.0.path())).expect("looks"), Some(newest));
    let out = data.0.path().join("out");
    let results = import_path(
        Format::OpenScene,
        &data.root(),
        crate::Choice { maps: Some(&other), ..crate::Choice::default() },
        &out,
        &mut |_| (),
    )
    .expect("lists");
    let (file, _) = results[0].outcome.as_ref().expect("it imports");
    assert_eq!(ds_scenario::load(file).expect("it loads again").0.map.lanes.len(), 9);
}

/// Spoils a map with statements and returns what is said of it.
fn spoiled(statements: &str) -> Result<Vec<Warning>, String> {
    let data = Data::mapped();
    let sheet = Connection::open(data.map()).expect("opens");
    sheet.execute_batch(statements).expect("the statements run");
    drop(sheet);
    data.scene().map(|(_, warnings)| warnings).map_err(|error| chain(&error))
}

#[test]
fn spoiled_maps_are_refused_by_name() {
    let check = |statements: &str, says: &[&str]| {
        let error = spoiled(statements).expect_err(statements);
        for part in says.iter().chain(&["map.gpkg"]) {
            assert!(error.contains(part), "{statements}: {error:?} does not say {part:?}");
        }
    };
    check("DROP TABLE lanes_polygons", &["no layer \"lanes_polygons\""]);
    check("DROP TABLE stop_polygons", &["no layer \"stop_polygons\""]);
    check(
        "ALTER TABLE crosswalks RENAME TO walks; CREATE VIEW crosswalks AS SELECT * FROM walks",
        &["no layer \"crosswalks\""],
    );
    check("ALTER TABLE lanes_polygons RENAME COLUMN lane_fid TO lane", &["\"lanes_polygons\"", "column \"lane_fid\""]);
    check("ALTER TABLE boundaries RENAME COLUMN geom TO shape", &["\"boundaries\"", "no column \"geom\""]);
    check("DELETE FROM gpkg_geometry_columns WHERE table_name = 'boundaries'", &["no column \"geometry\""]);
    check("UPDATE gpkg_geometry_columns SET srs_id = 0 WHERE table_name = 'boundaries'", &["NONE:0", "EPSG:32619"]);
    check("UPDATE gpkg_geometry_columns SET srs_id = 7 WHERE table_name = 'boundaries'", &["system \"7\""]);
    check("UPDATE meta SET value = 'epsg:3857'", &["\"epsg:3857\" is no UTM zone"]);
    check("DELETE FROM meta", &["no key \"projectedCoordSystem\""]);
    check("DROP TABLE meta", &["no layer \"meta\""]);
    check("UPDATE crosswalks SET geom = substr(geom, 1, 40)", &["\"crosswalks\", row 401 is damaged", "more bytes"]);
    check("UPDATE crosswalks SET geom = 'POLYGON'", &["\"crosswalks\", row 401", "no blob"]);
    check("UPDATE lanes_polygons SET geom = x'00' WHERE fid = 101", &["\"lanes_polygons\", row 101 is damaged"]);
    for (statements, says) in [
        ("DROP TABLE carpark_areas", "no layer \"carpark_areas\""),
        ("DELETE FROM baseline_paths WHERE lane_fid = 105", "1 lanes without a baseline path"),
        (
            "DROP TABLE rtree_baseline_paths_geom; ALTER TABLE lanes_polygons RENAME COLUMN lane_type_fid TO kind",
            "moved",
        ),
        ("UPDATE crosswalks SET geom = NULL", "moved"),
    ] {
        let said = said(&spoiled(statements).expect(statements));
        assert!(said.contains(says), "{statements}: {said:?} does not say {says:?}");
    }
}

#[test]
fn no_damage_to_the_file_breaks_the_reader() {
    let data = Data::mapped();
    let whole = std::fs::read(data.map()).expect("reads");
    let read = |bytes: &[u8]| {
        std::fs::write(data.map(), bytes).expect("writes");
        super::read(&data.map(), BASE, &[BASE], &mut Vec::new()).map(|_| ()).map_err(|error| chain(&error))
    };
    assert_eq!(read(&whole), Ok(()));
    let refused = |bytes: &[u8]| read(bytes).expect_err("it is refused");
    assert!(refused(b"no map").contains("map refused"), "{}", refused(b"no map"));
    refused(&whole[..whole.len() / 2]);
    let mut number = 7u64;
    for _ in 0..200 {
        let mut bytes = whole.clone();
        for _ in 0..8 {
            // Any bytes will do; these are the same in every run.
            number = number.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let at = (number >> 20) as usize % bytes.len();
            bytes[at] = (number >> 8) as u8;
        }
        // Read or refused, but in an orderly way.
        let _ = read(&bytes);
    }
}

/// The file that tests of other crates use is the drawn one. `UPDATE_GOLDEN=1 cargo test -p ds-scenario` rewrites it.
#[test]
fn the_committed_map_is_the_drawn_one() {
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        _ = std::fs::remove_file(COMMITTED);
        drawn::map(Path::new(COMMITTED));
    }
    let data = Data::mapped();
    let read = |path: &Path| super::read(path, BASE, &[BASE], &mut Vec::new()).expect("it is whole").map;
    assert_eq!(read(Path::new(COMMITTED)), read(&data.map()));
}

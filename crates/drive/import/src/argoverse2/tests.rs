//! Logs of Argoverse 2: small made-up ones, spoiled ones, Feather files of other writers, the real ones where at hand.

use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

use arrow_array::{ArrayRef, Float64Array, Int64Array, LargeStringArray, RecordBatch};
use ds_space::Tick;
use ds_space::plane;
use ds_world::{LaneId, LaneKind, LineColour, LineKind, VehicleParameters};

use super::column::Column;
use super::table::Table;
use super::*;
use crate::format::{Format, files, open};

const TRACKS: [(&str, &str); 3] = [("car", "REGULAR_VEHICLE"), ("walker", "PEDESTRIAN"), ("board", "SIGN")];
/// A rotation by 90° to the left.
const NORTH: &str = "0.7071067811865476,0,0,0.7071067811865476";

fn stamp(secs: f64) -> i64 {
    315_973_157_000_000_000 + (secs * 1e9).round() as i64
}

/// The ego drives north at 5 m/s from (1000, 2000).
fn poses() -> String {
    let mut text = "timestamp_ns,qw,qx,qy,qz,tx_m,ty_m,tz_m\n".to_owned();
    for i in -1..=43 {
        let secs = 0.05 * f64::from(i);
        writeln!(text, "{},{NORTH},1000.0,{},50.0", stamp(secs), 2000.0 + 5.0 * secs).expect("writes");
    }
    text
}

/// A car stays 20 m ahead; a walker to the left is gone for half a second; a sign is no road user.
fn annotations() -> String {
    let mut text =
        "timestamp_ns,track_uuid,category,length_m,width_m,height_m,qw,qx,qy,qz,tx_m,ty_m,tz_m,num_interior_pts\n"
            .to_owned();
    for sweep in 0..=20 {
        for (i, (name, category)) in TRACKS.iter().enumerate() {
            if i == 1 && (6..=9).contains(&sweep) {
                continue;
            }
            let (x, y) = [(20.0, 0.0), (10.0, 4.0), (0.0, -6.0)][i];
            let stamp = stamp(0.1 * f64::from(sweep));
            writeln!(text, "{stamp},{name},{category},4.5,1.9,1.6,1,0,0,0,{x},{y},0.5,12").expect("writes");
        }
    }
    text
}

/// Two lanes to the north with a dashed line between them, a crossing, and a drivable area in two parts.
fn map() -> serde_json::Value {
    let north = |x: f64| serde_json::json!([{"x": x, "y": 1980.0, "z": 50.0}, {"x": x, "y": 2100.0, "z": 50.0}]);
    let lane = |id: u32, x: f64, marks: [&str; 2], beside: [Option<u32>; 2]| {
        serde_json::json!({"id": id, "is_intersection": id == 2, "lane_type": "VEHICLE",
            "left_lane_boundary": north(x - 1.75), "right_lane_boundary": north(x + 1.75),
            "left_lane_mark_type": marks[0], "right_lane_mark_type": marks[1], "successors": [9], "predecessors": [],
            "left_neighbor_id": beside[0], "right_neighbor_id": beside[1]})
    };
    let square = |y: [f64; 2]| {
        serde_json::json!({"area_boundary": [{"x": 994.0, "y": y[0]}, {"x": 1006.0, "y": y[0]}, {"x": 1006.0, "y": y[1]},
            {"x": 994.0, "y": y[1]}, {"x": 994.0, "y": y[0]}]})
    };
    serde_json::json!({
        "lane_segments": {
            "1": lane(1, 1000.0, ["DOUBLE_SOLID_YELLOW", "DASHED_WHITE"], [None, Some(2)]),
            "2": lane(2, 1003.5, ["DASHED_WHITE", "SOLID_PINK"], [Some(1), None]),
        },
        "drivable_areas": {"5": square([1980.0, 2040.0]), "6": square([2040.0, 2100.0])},
        "pedestrian_crossings": {"7": {"id": 7, "edge1": [{"x": 994.0, "y": 2050.0}, {"x": 1006.0, "y": 2050.0}],
            "edge2": [{"x": 994.0, "y": 2053.0}, {"x": 1006.0, "y": 2053.0}]}}
    })
}

/// The recording car drives north; a bus follows it from step 3 on.
fn steps(ego: &str) -> String {
    let mut text = "observed,track_id,object_type,object_category,timestep,position_x,position_y,heading,velocity_x,\
                    velocity_y,scenario_id,focal_track_id,city\n"
        .to_owned();
    for step in 0..=20 {
        let y = 2000.0 + 0.5 * f64::from(step);
        for (name, kind, y) in [(ego, "vehicle", y), ("12", "bus", y - 15.0), ("13", "background", y)] {
            if name != "12" || step >= 3 {
                writeln!(text, "True,{name},{kind},1,{step},1000.0,{y},1.5707963,0.0,5.0,0a1e6f0a,12,austin")
                    .expect("writes");
            }
        }
    }
    text
}

fn write(folder: &Path, name: &str, text: &str) {
    let path = folder.join(name);
    std::fs::create_dir_all(path.parent().expect("a folder")).expect("makes");
    std::fs::write(path, text).expect("writes");
}

/// Returns the first line.
fn head(text: &str) -> &str {
    text.lines().next().unwrap_or_default()
}

fn log(folder: &Path) {
    write(folder, "city_SE3_egovehicle.csv", &poses());
    write(folder, "annotations.csv", &annotations());
    write(folder, "map/log_map_archive_small____PIT_city_31785.json", &map().to_string());
}

fn scenario(folder: &Path, ego: &str) {
    write(folder, "scenario_0a1e6f0a.csv", &steps(ego));
    write(folder, "log_map_archive_0a1e6f0a.json", &map().to_string());
}

fn says(warnings: &[Warning], part: &str) -> bool {
    warnings.iter().any(|warning| warning.to_string().contains(part))
}

#[test]
fn a_sensor_log_becomes_a_scene() {
    let folder = tempfile::tempdir().expect("a folder");
    log(folder.path());
    let (scene, warnings) = read(folder.path()).expect("reads");
    assert_eq!((scene.ego_log.len(), scene.tracks.len(), scene.dt.secs()), (21, 2, 0.1));
    assert_eq!(scene.prompt, "front camera view of a street in Pittsburgh");
    assert_eq!(
        (scene.origin.licence.as_str(), scene.origin.attribution.as_str()),
        ("CC-BY-NC-SA-4.0", "Argoverse 2, Argo AI")
    );
    for tick in 0..=20 {
        let world = scene.logged_world(Tick(tick));
        let ahead = DVec2::new(0.0, 20.0 + 0.5 * f64::from(tick));
        let car = &world.agents[0];
        assert!((world.ego.pose.position - DVec2::new(0.0, ahead.y - 20.0)).length() < 1e-3, "{:?}", world.ego.pose);
        assert!((car.pose.position - world.ego.pose.position - DVec2::new(0.0, 20.0)).length() < 1e-3);
        assert!(
            (world.ego.speed_mps() - 5.0).abs() < 1e-3 && (car.velocity_mps - DVec2::new(0.0, 5.0)).length() < 1e-3
        );
        assert!((car.z_m - 0.02).abs() < 1e-6, "{}", car.z_m);
        assert_eq!(world.agents.len(), if (6..=9).contains(&tick) { 1 } else { 2 }, "tick {tick}");
    }
    let map = &scene.map;
    assert_eq!((map.lanes.len(), map.junctions.len(), map.crosswalks.len(), map.drivable.len()), (2, 1, 1, 2));
    assert_eq!((map.lanes[0].right, map.lanes[1].left), (Some(LaneId(1)), Some(LaneId(0))));
    assert_eq!((map.lanes[0].kind, map.lanes[1].kind), (LaneKind::Road, LaneKind::Connector));
    assert!(map.lanes[0].centre_line.iter().all(|point| point.x.abs() < 1e-6));
    let marks: Vec<_> = map.line_markings.iter().map(|line| (line.kind, line.colour)).collect();
    assert_eq!(marks, [(LineKind::Double, LineColour::Yellow), (LineKind::Dashed, LineColour::White)]);
    let inner = map.road_edges.iter().flat_map(|edge| &edge.points).filter(|point| (point.y - 40.0).abs() < 1.0);
    assert!(inner.clone().all(|point| point.x.abs() > 5.0), "a kerb across the road: {:?}", inner.collect::<Vec<_>>());
    assert!(plane::polygon::holds(&map.crosswalks[0].polygon, DVec2::new(0.0, 51.0)));
    for part in ["moved by", "\"SIGN\"", "\"SOLID_PINK\""] {
        assert!(says(&warnings, part), "{warnings:?} lacks {part}");
    }
    write(
        folder.path(),
        "calibration/intrinsics.csv",
        "sensor_name,fx_px,fy_px,cx_px,cy_px,k1,k2,k3,height_px,width_px\n\
        ring_front_left,1,1,1,1,0,0,0,1,1\nring_front_center,1683.5,1683.5,773.5,1019.3,-0.2,-0.1,0.2,2048,1550\n",
    );
    write(
        folder.path(),
        "calibration/egovehicle_SE3_sensor.csv",
        "sensor_name,qw,qx,qy,qz,tx_m,ty_m,tz_m\n\
        up_lidar,1,0,0,0,0,0,0\nring_front_center,0.5,-0.5,0.5,-0.5,1.6,0.0,1.4\n",
    );
    let camera = &read(folder.path()).expect("reads").0.cameras[0];
    assert_eq!(
        (camera.id.as_str(), camera.intrinsics.width_px, camera.intrinsics.k1),
        ("ring_front_center", 1550, 0.0)
    );
    let ahead = camera.rig_from_camera * ds_space::DVec3::new(0.0, 0.0, 10.0);
    assert!((ahead - ds_space::DVec3::new(11.6, 0.0, 1.72)).length() < 1e-6, "{ahead}");
    std::fs::remove_file(folder.path().join("annotations.csv")).expect("removes");
    let (bare, warnings) = read(folder.path()).expect("reads");
    assert_eq!((bare.ego_log.len(), bare.tracks.len()), (23, 0));
    assert!(says(&warnings, "the ego and the map alone"), "{warnings:?}");
}

#[test]
fn a_forecasting_scenario_becomes_a_scene() {
    for ego in ["AV", "12"] {
        let folder = tempfile::tempdir().expect("a folder");
        scenario(folder.path(), ego);
        if ego == "12" {
            write(folder.path(), "scenario_0a1e6f0a.csv", &steps("11"));
        }
        let (scene, warnings) = read(folder.path()).expect("reads");
        let expected = if ego == "AV" { (21, "12", 18) } else { (18, "11", 18) };
        let seen = scene.tracks[0].points.iter().flatten().count();
        assert_eq!((scene.ego_log.len(), scene.tracks[0].name.as_str(), seen), expected);
        assert_eq!((scene.name.as_str(), scene.tracks.len()), ("0a1e6f0a", 1));
        assert_eq!(scene.prompt, "front camera view of a street in Austin");
        // A straight drive does not tell which point the log gives; then it is the centre, as the format says.
        let back_m = VehicleParameters::FUSION.rear_axle_to_centre_m;
        let start_m = if ego == "AV" { 0.0 } else { -0.5 };
        assert!((scene.ego_log[0].pose.position - DVec2::new(0.0, start_m - back_m)).length() < 1e-2);
        assert!((scene.ego_log[9].speed_mps() - 5.0).abs() < 1e-3);
        for part in ["\"background\"", "sizes are not in the log"] {
            assert!(says(&warnings, part), "{warnings:?} lacks {part}");
        }
    }
}

#[test]
#[expect(clippy::too_many_lines, reason = "one row a damage")]
fn spoiled_logs_are_refused_by_name() {
    let check = |kind: fn(&Path), spoil: &dyn Fn(&Path), expected: &[&str]| {
        let folder = tempfile::tempdir().expect("a folder");
        kind(folder.path());
        spoil(folder.path());
        let error = read(folder.path()).expect_err(expected[0]);
        let source = std::error::Error::source(&error).map(ToString::to_string).unwrap_or_default();
        let text = format!("{error}: {source}");
        assert!(expected.iter().all(|part| text.contains(part)), "{text:?} does not say {expected:?}");
    };
    let forecast: fn(&Path) = |folder| scenario(folder, "AV");
    let poses_file = "city_SE3_egovehicle.csv";
    let scenario_file = "scenario_0a1e6f0a.csv";
    let map_file = "map/log_map_archive_small____PIT_city_31785.json";
    let replace = |name: &'static str, from: &'static str, to: &'static str| {
        move |folder: &Path| {
            let text = std::fs::read_to_string(folder.join(name)).expect("reads");
            assert!(text.contains(from), "{name} has no {from}");
            std::fs::write(folder.join(name), text.replacen(from, to, 1)).expect("writes");
        }
    };
    let remove = |name: &'static str| move |folder: &Path| std::fs::remove_file(folder.join(name)).expect("removes");
    let rename = |from: &'static str, to: &'static str| {
        move |folder: &Path| std::fs::rename(folder.join(from), folder.join(to)).expect("renames")
    };
    let broken = |from: &'static str, to: &'static str, says: &[&str]| {
        check(log, &replace(map_file, from, to), &[&["log_map_archive"][..], says].concat());
    };
    check(log, &remove(poses_file), &["no city_SE3_egovehicle or scenario*"]);
    check(log, &remove(map_file), &["no log_map_archive*.json"]);
    check(forecast, &remove("log_map_archive_0a1e6f0a.json"), &["no log_map_archive*.json"]);
    check(log, &rename(poses_file, "city_SE3_egovehicle.feather"), &["no whole Feather file"]);
    check(log, &rename(poses_file, "city_SE3_egovehicle.parquet"), &["read_parquet", "city_SE3_egovehicle.parquet"]);
    check(log, &replace(poses_file, "qz,", "q,"), &[poses_file, "\"qz\"", "no column"]);
    check(log, &replace(poses_file, "1000.0", "NaN"), &["tx_m[0]", "NaN"]);
    check(log, &replace(poses_file, "1000.0", "far"), &["tx_m[0]", "far"]);
    check(log, &replace(poses_file, "1000.0", "1000.0,1"), &["row 0", "9 cells", "8"]);
    check(log, &replace(poses_file, "0.7071067811865476", "0.1"), &["qw[0]", "quaternion"]);
    check(log, &replace(poses_file, "2000.5", "9e300"), &["ego_log"]);
    check(log, &|folder| write(folder, poses_file, "timestamp_ns,qw,qx,qy,qz,tx_m,ty_m,tz_m\n"), &["has no rows"]);
    check(log, &|folder| write(folder, poses_file, ""), &["head"]);
    check(log, &|folder| std::fs::write(folder.join(poses_file), [0xff, 0xfe]).expect("writes"), &["UTF-8"]);
    check(log, &replace("annotations.csv", "category", "kind"), &["annotations.csv", "\"category\""]);
    check(log, &replace("annotations.csv", "walker", "car"), &["track_uuid[1]", "two boxes"]);
    check(log, &replace("annotations.csv", "4.5,", "-4.5,"), &["length_m[0]", "-4.5"]);
    check(log, &replace("annotations.csv", "315973157000000000", "315973150000000000"), &["outside of the ego poses"]);
    check(log, &|folder| write(folder, "annotations.csv", head(&annotations())), &["key frames"]);
    check(
        log,
        &|folder| {
            write(
                folder,
                "intrinsics.csv",
                "sensor_name,fx_px,fy_px,cx_px,cy_px,height_px,width_px\nother,1,1,1,1,1,1\n",
            );
            write(folder, "egovehicle_SE3_sensor.csv", "sensor_name,qw,qx,qy,qz,tx_m,ty_m,tz_m\nother,1,0,0,0,0,0,0\n");
        },
        &["sensor_name", "ring_front_center"],
    );
    broken("{", "", &["line 1"]);
    broken("is_intersection", "is_junction", &["lane_segments.1", "is_intersection"]);
    broken("1001.75", "1e300", &["lane_segments.1.right_lane_boundary[0]", "more than"]);
    broken("1001.75", "1e999", &["number out of range"]);
    check(log, &replace(map_file, "\"id\":2", "\"id\":1"), &["map.lanes[1].name"]);
    check(
        log,
        &|folder| {
            let mut map = map();
            map["lane_segments"]["2"]["left_lane_boundary"] = serde_json::json!([{"x": 1.0, "y": 2.0}]);
            write(folder, map_file, &map.to_string());
        },
        &["lane_segments.2.left_lane_boundary"],
    );
    check(forecast, &replace(scenario_file, ",20,", ",0.5,"), &["timestep", "0.5"]);
    check(forecast, &replace(scenario_file, ",20,", ",99999,"), &["timestep", "99999"]);
    check(forecast, &replace(scenario_file, ",20,", ",19,"), &["timestep", "twice"]);
    check(forecast, &replace(scenario_file, "heading", "yaw"), &["\"heading\""]);
    check(
        forecast,
        &|folder| write(folder, scenario_file, &steps("AV").replace("AV", "11").replace(",12,austin", ",77,austin")),
        &["\"77\""],
    );
    check(forecast, &|folder| write(folder, scenario_file, head(&steps("AV"))), &["focal_track_id"]);
}

/// Writes a CSV table as Feather.
fn feathered(path: &Path) {
    let texts = ["track_uuid", "category", "sensor_name"];
    let text = std::fs::read_to_string(path).expect("reads");
    let head: Vec<&str> = text.lines().next().expect("a head").split(',').collect();
    let table = Table::read(path, &head).expect("reads");
    let column = |name: &&str| -> (String, ArrayRef) {
        let array: ArrayRef = if texts.contains(name) {
            Arc::new(LargeStringArray::from(table.texts(name).expect("texts")))
        } else if *name == "timestamp_ns" {
            let stamps = table.texts(name).expect("texts");
            Arc::new(stamps.iter().map(|stamp| stamp.parse::<i64>().expect("a whole number")).collect::<Int64Array>())
        } else {
            Arc::new(Float64Array::from(table.numbers(name).expect("numbers")))
        };
        ((*name).to_owned(), array)
    };
    let batch = RecordBatch::try_from_iter(head.iter().map(column)).expect("a batch");
    let file = std::fs::File::create(path.with_extension("feather")).expect("makes");
    let mut writer = arrow_ipc::writer::FileWriter::try_new(file, &batch.schema()).expect("writes");
    // Two batches, as large tables have several.
    let half = batch.num_rows() / 2;
    writer.write(&batch.slice(0, half)).expect("writes");
    writer.write(&batch.slice(half, batch.num_rows() - half)).expect("writes");
    writer.finish().expect("writes");
    std::fs::remove_file(path).expect("removes");
}

#[test]
fn feather_tables_read_as_csv_tables_do() {
    let folder = tempfile::tempdir().expect("a folder");
    log(folder.path());
    let expected = read(folder.path()).expect("reads");
    feathered(&folder.path().join("city_SE3_egovehicle.csv"));
    feathered(&folder.path().join("annotations.csv"));
    assert_eq!(read(folder.path()).expect("reads"), expected);
}

/// Written by pyarrow 26: `feather.write_feather(table, path, compression="lz4", chunksize=25)`, and "zstd".
const PACKED: [&[u8]; 2] =
    [include_bytes!("../../tests/data/cells.lz4.feather"), include_bytes!("../../tests/data/cells.zstd.feather")];
const CELLS: [&str; 7] = ["timestamp_ns", "track_uuid", "category", "length_m", "width_m", "num_interior_pts", "seen"];

#[test]
fn packed_feather_files_of_another_writer_are_read() {
    for bytes in PACKED {
        let (rows, columns) = feather::columns(bytes, &CELLS).expect("reads");
        assert_eq!((rows, columns.len()), (40, 7));
        for (name, column) in columns {
            match (name.as_str(), column) {
                ("track_uuid", Column::Texts(cells)) => assert_eq!(cells[38], "track-2"),
                ("category", Column::Texts(cells)) => assert_eq!([&cells[38], &cells[39]], ["BUS", ""]),
                ("timestamp_ns", Column::Numbers(cells)) => {
                    assert!((cells[39] - 315_973_161_859_879_000.0).abs() < 65.0)
                }
                ("length_m", Column::Numbers(cells)) => assert_eq!(cells[39], 19.5),
                ("width_m", Column::Numbers(cells)) => assert!(cells[0].is_nan() && cells[39] == 9.75),
                ("num_interior_pts", Column::Numbers(cells)) => assert_eq!([cells[0], cells[39]], [-3.0, 36.0]),
                ("seen", Column::Numbers(cells)) => assert_eq!(cells[36..], [1.0, 0.0, 0.0, 1.0]),
                (name, column) => panic!("{name} is {column:?}"),
            }
        }
    }
}

#[test]
fn spoiled_feather_files_end_in_errors() {
    for bytes in PACKED {
        for length in 0..bytes.len() {
            feather::columns(&bytes[..length], &CELLS).expect_err("it is cut off");
        }
        // Whatever a byte becomes, there is an answer; a changed cell may go unnoticed.
        for at in 0..bytes.len() {
            for flip in [0x01, 0x80, 0xff] {
                let mut spoiled = bytes.to_vec();
                spoiled[at] ^= flip;
                drop(feather::columns(&spoiled, &CELLS));
            }
        }
    }
}

#[test]
fn logs_are_told_by_their_files() {
    let folder = tempfile::tempdir().expect("a folder");
    log(&folder.path().join("a"));
    scenario(&folder.path().join("b"), "AV");
    for name in ["c.pkl", "dataset_summary.pkl", "d.scenario.json", "e/notes.csv", "scenario.csv"] {
        write(folder.path(), name, "");
    }
    let names = |paths: Vec<std::path::PathBuf>| -> Vec<String> {
        paths.iter().map(|path| path.file_name().expect("a name").to_string_lossy().into_owned()).collect()
    };
    assert_eq!(names(files(folder.path()).expect("lists")), ["a", "b", "c.pkl", "d.scenario.json"]);
    assert_eq!(names(files(&folder.path().join("a")).expect("lists")), ["a"]);
    let (out, mut heard) = (folder.path().join("out"), 0);
    let results =
        crate::import_path(Format::Argoverse2, folder.path(), crate::Choice::default(), &out, &mut |_| heard += 1)
            .expect("lists");
    assert_eq!((results.len(), heard), (2, 2));
    for imported in results {
        let (file, _) = imported.outcome.expect("imports");
        assert_eq!(open(&file).expect("loads").0, open(&imported.log).expect("reads").0);
    }
    let nothing =
        crate::import_path(Format::Argoverse2, &folder.path().join("e"), crate::Choice::default(), &out, &mut |_| ());
    assert!(nothing.expect_err("no log").to_string().contains("no log of Argoverse 2"));
}

#[test]
fn real_logs_are_whole_scenes() {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../../shared/data/argoverse2"));
    if !folder.is_dir() {
        eprintln!("skipped: {} is absent", folder.display());
        return;
    }
    // Ticks, tracks (146 less 6 signs; 58 less the ego and 10 static), lanes, metres driven (of the first log 40.4 over
    // all poses, which go on for 0.4 s after the last sweep).
    let logs = [
        ("sensor-log-adcf7d18", (156, 140, 199), 38.2),
        ("sensor-log-3bffdcff", (160, 0, 211), 88.3),
        ("forecasting-0a1e6f0a", (110, 47, 71), 55.0),
    ];
    for (name, counts, driven_m) in logs {
        let (scene, warnings) = read(&folder.join(name)).expect(name);
        eprintln!("{}{warnings:#?}", ds_scenario::describe(&scene));
        assert_eq!((scene.ego_log.len(), scene.tracks.len(), scene.map.lanes.len()), counts, "{name}");
        let path_m: f64 =
            scene.ego_log.windows(2).map(|pair| pair[0].pose.position.distance(pair[1].pose.position)).sum();
        assert!((path_m - driven_m).abs() < 1.0, "{name}: {path_m} m");
        let on_road = |point: DVec2| scene.map.drivable.iter().any(|area| plane::polygon::holds(area, point));
        assert!(scene.ego_log.iter().all(|state| on_road(state.pose.position)), "{name}: the ego is off the road");
        let vehicles = scene.tracks.iter().filter(|track| track.class == AgentClass::Vehicle);
        let boxes: Vec<DVec2> =
            vehicles.flat_map(|track| &track.points).flatten().map(|point| point.pose.position).collect();
        let inside = boxes.iter().filter(|point| on_road(**point)).count();
        eprintln!("{name}: {inside} of {} boxes of vehicles on the road", boxes.len());
        assert!(inside * 100 >= boxes.len() * 75, "{name}: {inside} of {} boxes are on the road", boxes.len());
        let near = |state: &ds_world::EgoState| {
            scene.map.lanes.iter().any(|lane| plane::polygon::holds(&lane.polygon, state.pose.position))
        };
        assert!(scene.ego_log.iter().all(near), "{name}: the ego is in no lane");
        let linked = scene.map.lanes.iter().filter(|lane| !lane.successors.is_empty()).count();
        assert!(linked * 100 >= scene.map.lanes.len() * 75, "{name}: {linked} lanes have successors");
    }
}

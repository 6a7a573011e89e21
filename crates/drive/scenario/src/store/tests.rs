//! Files: round trips, refusals with place and value, listing.

use super::*;
use crate::{Family, generate};
use std::fs;

fn text() -> String {
    to_text(&generate(Family::SignalisedCrossing, 1), Path::new("x")).expect("generated scenes are valid")
}

#[test]
fn a_saved_scene_loads_as_it_was() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    for family in Family::ALL {
        let scene = generate(family, 3);
        let path = folder.path().join(format!("a/{family}.scenario.json"));
        save(&scene, &path).expect("generated scenes can be saved");
        let (loaded, warnings) = load(&path).expect("saved scenes can be loaded");
        assert_eq!(loaded, scene);
        assert_eq!(warnings, []);
        let compact: serde_json::Value =
            serde_json::from_slice(&fs::read(&path).expect("it was written")).expect("it is JSON");
        let (again, _) = parse(compact.to_string().as_bytes(), &path).expect("layout does not matter");
        assert_eq!(again.digest, scene.digest);
    }
    let listed = list(folder.path()).expect("the folder can be read");
    assert_eq!(listed.len(), 8);
    assert!(describe(&load(&listed[0]).expect("it loads").0).contains("cut-in"));
}

/// Sets the value at a path of keys and indices (separated by `/`) and returns the text.
fn with(path: &str, value: serde_json::Value) -> Vec<u8> {
    let mut document: serde_json::Value = serde_json::from_str(&text()).expect("saved scenes are JSON");
    let (parent, key) = path.rsplit_once('/').expect("paths begin with a slash");
    let parent = document.pointer_mut(parent).expect("the path exists");
    match parent {
        serde_json::Value::Array(items) => items[key.parse::<usize>().expect("an index")] = value,
        serde_json::Value::Object(fields) => {
            fields.insert(key.to_owned(), value);
        }
        _ => panic!("{path} has no parent that holds values"),
    }
    document.to_string().into_bytes()
}

fn refused(bytes: &[u8], says: &[&str]) {
    let error = parse(bytes, Path::new("bad.scenario.json")).expect_err(says[0]).to_string();
    for part in says.iter().chain(&["bad.scenario.json"]) {
        assert!(error.contains(part), "{error:?} does not say {part:?}");
    }
}

#[test]
fn refuses_hostile_files_with_place_and_value() {
    use serde_json::json;
    refused(b"", &["EOF"]);
    refused(&text().as_bytes()[..5000], &["EOF"]);
    refused("[".repeat(100_000).as_bytes(), &["scenario refused"]);
    refused(&with("/format", json!("other")), &["\"format\"", "other"]);
    refused(&with("/version", json!(9)), &["\"version\"", "9"]);
    refused(&with("/version", json!(1)), &["version", "structures", "2"]);
    refused(&with("/map/structures/3/top_m", json!(0.0)), &["map.structures[3].top_m", "bottom_m"]);
    refused(&with("/map/structures/3/outline_m", json!([[0.0, 0.0], [1.0, 0.0]])), &["structures[3].outline_m", "3"]);
    refused(&with("/map/structures/3/kind", json!("castle")), &["castle", "building"]);
    refused(&with("/frame", json!("x-north")), &["\"frame\"", "x-north"]);
    refused(&with("/name", json!("../../etc/passwd")), &["\"name\"", "../../etc/passwd"]);
    refused(&with("/surprise", json!(1)), &["surprise"]);
    refused(&with("/dt_secs", json!(0.0)), &["\"dt_secs\"", "is 0"]);
    refused(&with("/tracks/1/x_m/0", json!(1e300)), &["\"tracks[1].x_m[0]\"", "is 1"]);
    refused(&with("/tracks/1/x_m/0", json!("a")), &["\"tracks[1].x_m[0]\"", "a"]);
    refused(&with("/tracks/1/width_m", json!(-1.5)), &["\"tracks[1].width_m\"", "-1.5"]);
    refused(
        &with("/tracks/1/valid_ticks", json!([[0, 4_000_000_000u32]])),
        &["\"tracks[1].valid_ticks[0]\"", "4000000000"],
    );
    refused(&with("/tracks/1/valid_ticks", json!([[5, 9], [7, 8]])), &["\"tracks[1].valid_ticks[1]\"", "[7, 8]"]);
    refused(&with("/tracks/1/y_m", json!([1.0, 2.0])), &["\"tracks[1].y_m\"", "has 2 values"]);
    refused(&with("/tracks/1/name", json!("vehicle-0")), &["\"tracks[1].name\"", "vehicle-0"]);
    refused(&with("/ego_log/x_m", json!([1.0])), &["\"ego_log.x_m\"", "has 1 values"]);
    refused(&with("/ego_log/heading_rad", json!([])), &["\"ego_log.heading_rad\"", "has 0 values"]);
    refused(&with("/map/lanes/0/successors", json!(["nowhere"])), &["\"map.lanes[0].successors[0]\"", "nowhere"]);
    refused(
        &with("/map/lanes/0/centre_line_m", json!([[0.0, 0.0]])),
        &["\"map.lanes[0].centre_line_m\"", "has 1 points"],
    );
    refused(&with("/map/lane_lines/2/points_m", json!([])), &["\"map.lane_lines[2].points_m\"", "has 0 points"]);
    refused(&with("/map/drivable_m/0", json!([[0.0, 0.0], [1.0, 1.0]])), &["\"map.drivable_m[0]\"", "has 2 points"]);
    refused(&with("/map/stop_lines/0/light", json!(77)), &["\"map.stop_lines[0].light\"", "77"]);
    refused(
        &with("/map/traffic_lights/0/states", json!([["red", 4_000_000_000u32]])),
        &["\"map.traffic_lights[0].states[0]\"", "4000000000"],
    );
    refused(&with("/map/traffic_lights/0/states", json!([["blue", 4]])), &["map.traffic_lights[0].states[0]", "blue"]);
    refused(&with("/cameras", json!([])), &["\"cameras\"", "has 0 cameras"]);
    refused(&with("/cameras/0/width_px", json!(1_000_000)), &["\"cameras[0].width_px\"", "1000000"]);
    refused(&with("/cameras/0/fx_px", json!(0.0)), &["\"cameras[0].fx_px\"", "is 0"]);
    refused(&with("/cameras/0/name", json!("a/b")), &["\"cameras[0].name\"", "a/b"]);
    refused(&with("/vehicle/wheel_base_m", json!(50.0)), &["\"vehicle.wheel_base_m\"", "50"]);
    refused(&with("/route_m", json!([[1.0, 1.0], [1.0, 1.0]])), &["\"route_m\"", "length is 0"]);
}

#[test]
fn refuses_more_states_than_fit_in_memory() {
    let scene = generate(Family::FreeCurve, 0);
    let mut document = compose::document(&scene);
    {
        let values = &mut document.ego_log.x_m;
        values.resize(20_000, 0.0);
    }
    for values in [
        &mut document.ego_log.y_m,
        &mut document.ego_log.heading_rad,
        &mut document.ego_log.forward_mps,
        &mut document.ego_log.left_mps,
        &mut document.ego_log.yaw_rate_radps,
        &mut document.ego_log.forward_mps2,
        &mut document.ego_log.left_mps2,
        &mut document.ego_log.steering_rad,
        &mut document.ego_log.steering_rate_radps,
    ] {
        values.truncate(1);
    }
    let part = serde_json::to_value(&document.tracks[0]).expect("a track is JSON");
    document.tracks = (0..200).map(|_| serde_json::from_value(part.clone()).expect("it was a track")).collect();
    let bytes = serde_json::to_vec(&document).expect("a document is JSON");
    refused(&bytes, &["\"tracks\"", "200 tracks of 20000 ticks"]);
}

#[test]
fn a_missing_file_is_named() {
    let error = load(Path::new("nowhere/there.scenario.json")).expect_err("there is no such file");
    assert!(error.to_string().contains("nowhere/there.scenario.json"), "{error}");
}

#[test]
fn warns_of_what_is_odd() {
    let mut scene = generate(Family::FreeCurve, 0);
    scene.map.drivable.clear();
    scene.ego_log[9].pose.position.x += 30.0;
    let places: Vec<String> = warnings(&scene).into_iter().map(|warning| warning.at).collect();
    assert_eq!(places, ["ego_log", "ego_log.x_m[9]"]);
}

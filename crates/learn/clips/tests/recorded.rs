//! Drives of data sets as clips: small folders of the same schema, and the real key frame where it is at hand.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use ds_clips::{ClipPlan, ClipSet, Progress, Recipe, outline, render};
use ds_import::{nuscenes, openscene};
use ds_layout::{LayoutBackend, LayoutScene, Renderer, StaticMap, colour};
use ds_raster::{Encoding, RgbImage};
use ds_space::{DMat3, DQuat, DVec3, Tick};
use ds_world::{AgentClass, LineKind};
use serde_json::{Value, json};

struct Quiet;

impl Progress for Quiet {
    fn made(&self, _clips: u64, _of: u64) {}
}

fn write(path: &Path, value: &Value) {
    std::fs::create_dir_all(path.parent().expect("a folder")).expect("makes");
    std::fs::write(path, value.to_string()).expect("writes");
}

/// Rotation of a camera that looks along x, as nuScenes gives it: w, x, y, z.
const AHEAD: [f64; 4] = [0.5, -0.5, 0.5, -0.5];

/// Writes a drive of `ticks` pictures at 10 Hz along x at 5 m/s, with a car 20 m ahead that drives as fast, on a hill.
fn nuscenes_folder(root: &Path, ticks: u32) {
    let tables = root.join("v1.0-test");
    let put = |name: &str, rows: Value| write(&tables.join(format!("{name}.json")), &rows);
    put("scene", json!([{"token": "s", "name": "scene-0001", "log_token": "l", "description": "Turn, Peds"}]));
    put("log", json!([{"token": "l", "location": "here"}]));
    put(
        "sensor",
        json!([{"token": "c", "channel": "CAM_FRONT", "modality": "camera"},
        {"token": "r", "channel": "LIDAR_TOP", "modality": "lidar"}]),
    );
    let lens = json!([[1200.0, 0.0, 800.0], [0.0, 1200.0, 450.0], [0.0, 0.0, 1.0]]);
    put(
        "calibrated_sensor",
        json!([
        {"token": "cc", "sensor_token": "c", "translation": [1.7, 0.0, 1.5], "rotation": AHEAD, "camera_intrinsic": lens},
        {"token": "cr", "sensor_token": "r", "translation": [0.9, 0.0, 1.8], "rotation": [1, 0, 0, 0], "camera_intrinsic": []}]),
    );
    put(
        "category",
        json!([{"token": "k", "name": "vehicle.car"}, {"token": "x", "name": "static_object.bicycle_rack"}]),
    );
    put("instance", json!([{"token": "i", "category_token": "k"}, {"token": "j", "category_token": "x"}]));
    let (mut samples, mut data, mut poses, mut boxes) = (vec![], vec![], vec![], vec![]);
    for tick in 0..ticks {
        let (stamp, x) = (1_000_000_000 + u64::from(tick) * 100_000, 100.0 + 0.5 * f64::from(tick));
        // A hill that climbs by a tenth; the car noses up with it.
        let up = (-0.05f64).sin();
        poses.push(json!({"token": format!("p{tick}"), "translation": [x, 50.0, 0.1 * x],
            "rotation": [(1.0 - up * up).sqrt(), 0.0, up, 0.0]}));
        let sample = tick / 5 * 5;
        let file = format!("samples/CAM_FRONT/{tick}.png");
        data.push(json!({"sample_token": format!("s{sample}"), "ego_pose_token": format!("p{tick}"), "filename": file,
            "calibrated_sensor_token": "cc", "timestamp": stamp, "width": 1600, "height": 900}));
        let shade = (40 + 10 * tick) as u8;
        let picture = RgbImage::filled(32, 18, [shade, 80, 120]).encode(Encoding::Png).expect("encodes");
        std::fs::create_dir_all(root.join("samples/CAM_FRONT")).expect("makes");
        std::fs::write(root.join(&file), picture).expect("writes");
        if tick % 5 == 0 {
            samples.push(json!({"token": format!("s{tick}"), "timestamp": stamp, "scene_token": "s"}));
            for instance in ["i", "j"] {
                boxes.push(json!({"sample_token": format!("s{tick}"), "instance_token": instance,
                    "translation": [x + 20.0, 50.0, 0.1 * (x + 20.0) + 0.75], "size": [1.8, 4.5, 1.5],
                    "rotation": [(1.0 - up * up).sqrt(), 0.0, up, 0.0]}));
            }
        }
    }
    put("sample", Value::Array(samples));
    put("sample_data", Value::Array(data));
    put("ego_pose", Value::Array(poses));
    put("sample_annotation", Value::Array(boxes));
    let node = |token: &str, x: f64, y: f64| json!({"token": token, "x": x, "y": y});
    let surface = |token: &str, polygon: &str| json!({"token": token, "polygon_token": polygon});
    write(
        &root.join("maps/expansion/here.json"),
        &json!({
            "node": [node("a", 60.0, 46.0), node("b", 200.0, 46.0), node("c", 200.0, 54.0), node("d", 60.0, 54.0),
                node("e", 130.0, 46.0), node("f", 133.0, 46.0), node("g", 133.0, 54.0), node("h", 130.0, 54.0),
                node("m", 60.0, 50.0), node("n", 200.0, 50.0), node("far", 9000.0, 0.0)],
            "line": [{"token": "mid", "node_tokens": ["m", "n"]}],
            "polygon": [{"token": "road", "exterior_node_tokens": ["a", "b", "c", "d"]},
                {"token": "walk", "exterior_node_tokens": ["e", "f", "g", "h"]},
                {"token": "away", "exterior_node_tokens": ["far", "far", "far"]}],
            "drivable_area": [{"token": "da", "polygon_tokens": ["road", "away"]}],
            "lane": [surface("lane", "road")], "ped_crossing": [surface("pc", "walk")],
            "lane_divider": [{"token": "ld", "line_token": "mid",
                "lane_divider_segments": [{"node_token": "m", "segment_type": "SINGLE_DASHED_WHITE"}]}],
            "arcline_path_3": {"lane": [{"start_pose": [60.0, 48.0, 0.0], "end_pose": [80.0, 48.0, 0.0], "shape": "LSR",
                "radius": 100.0, "segment_length": [0.0, 140.0, 0.0]}]},
            "connectivity": {"lane": {"incoming": [], "outgoing": []}}
        }),
    );
}

fn recipe(folder: &Path, source: &str, files: &Path, more: &str) -> Recipe {
    let models = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/models/smoke.toml");
    let text = format!(
        "version = 1\nname = \"real\"\nsplit = \"test\"\nsource = {source:?}\nmodel = {models:?}\nfolder = \"x\"\nseed = 1\n\
         frames = 4\nshard_clips = 4\n[scenarios]\nfiles = [{files:?}]\nclips_each = 2\n{more}\n\
         [appearance]\nconditions = [\"lighting=day,weather=clear,surface=dry\"]\n"
    );
    let path = folder.join("real.toml");
    std::fs::write(&path, text).expect("writes");
    Recipe::load(&path).expect("valid")
}

#[test]
fn a_nuscenes_folder_becomes_scene_pictures_and_clips() {
    let folder = tempfile::tempdir().expect("a folder");
    let root = folder.path().join("data");
    nuscenes_folder(&root, 11);
    assert_eq!(nuscenes::scenes(&root).expect("reads"), ["scene-0001"]);
    let recorded = nuscenes::read(&root, "scene-0001").expect("reads");
    let scene = &recorded.scene;
    assert_eq!((scene.last_tick().0, scene.cameras.len(), scene.tracks.len()), (10, 1, 1));
    assert!(recorded.pictures[0].iter().all(Option::is_some));
    // The box ahead stays where it is in the rig, though the car drives uphill.
    for tick in 0..=10 {
        let world = scene.logged_world(Tick(tick));
        let (ego, car) = (world.ego.pose, &world.agents[0]);
        let local = ego.to_local(car.pose.position);
        assert_eq!(car.class, AgentClass::Vehicle);
        assert!((local.x - 20.05).abs() < 0.15 && local.y.abs() < 1e-3, "tick {tick}: {local}");
        assert!(car.z_m.abs() < 0.2, "tick {tick}: the car floats at {} m", car.z_m);
        assert!((world.ego.speed_mps() - 5.0).abs() < 0.05 && (car.velocity_mps.length() - 5.0).abs() < 0.2);
        let seen = outline(car, &scene.cameras[0], ego.world_from_rig(0.0)).expect("it is ahead");
        assert!(seen[0] < 800.0 && seen[2] > 800.0 && seen[1] > 380.0 && seen[3] < 620.0, "tick {tick}: {seen:?}");
    }
    let map = &scene.map;
    assert_eq!((map.drivable.len(), map.lanes.len(), map.crosswalks.len()), (1, 1, 1));
    assert_eq!(map.line_markings[0].kind, LineKind::Dashed);
    assert_eq!(map.lanes[0].centre_line.last().map(|p| (p.x.round(), p.y.round())), Some((200.0, 48.0)));
    let recipe = recipe(folder.path(), "nuscenes", &root, "");
    let out = folder.path().join("out");
    render(&recipe, &out, &Quiet).expect("renders");
    let set = ClipSet::open(&out).expect("opens");
    assert_eq!(set.len(), 2);
    let (first, second) = (set.whole(0).expect("reads"), set.whole(1).expect("reads"));
    assert_eq!(first.frames[3].pixel(5, 5), [70, 80, 120], "the picture of tick 3");
    assert_eq!(second.frames[0].pixel(5, 5), [80, 80, 120], "the second clip begins where the first ends");
    assert_eq!(set.info(1).drive.from_tick, 4.0);
    let blue = first.layouts[0].rgb().chunks_exact(3).filter(|c| c[2] > c[0].saturating_add(60)).count();
    assert!(blue > 4, "the car is not in the layout");
}

#[test]
fn broken_nuscenes_folders_are_named() {
    let check = |spoil: &dyn Fn(&Path), expected: &str| {
        let folder = tempfile::tempdir().expect("a folder");
        nuscenes_folder(folder.path(), 6);
        spoil(folder.path());
        let error = nuscenes::read(folder.path(), "scene-0001").expect_err("refused");
        let mut text = error.to_string();
        let mut source = std::error::Error::source(&error);
        while let Some(error) = source {
            let _ = write!(text, ": {error}");
            source = error.source();
        }
        assert!(text.contains(expected), "{text:?} lacks {expected:?}");
    };
    let table = |name: &'static str, text: &'static str| {
        move |root: &Path| std::fs::write(root.join(format!("v1.0-test/{name}.json")), text).expect("writes")
    };
    check(&table("scene", "[]"), "has no \"scene-0001\"");
    check(&table("log", "[]"), "log.token");
    check(&table("ego_pose", "[]"), "ego_pose.token");
    check(&table("ego_pose", "[{\"token\": 3}]"), "[0].token");
    check(&table("sample", "{"), "sample.json");
    check(&|root| std::fs::remove_dir_all(root.join("v1.0-test")).expect("removes"), "folders of tables");
}

/// Pickles what a NAVSIM log holds, protocol 0: text, which any tool can write.
fn pickled(value: &Value, out: &mut String) {
    match value {
        Value::Null => out.push('N'),
        Value::Bool(value) => out.push_str(if *value { "I01\n" } else { "I00\n" }),
        Value::Number(number) if number.is_i64() => _ = writeln!(out, "I{number}"),
        Value::Number(number) => _ = writeln!(out, "F{number}"),
        Value::String(text) => _ = writeln!(out, "V{text}"),
        Value::Array(items) => {
            out.push_str("(l");
            for item in items {
                pickled(item, out);
                out.push('a');
            }
        }
        Value::Object(entries) => {
            out.push_str("(d");
            for (key, item) in entries {
                _ = writeln!(out, "V{key}");
                pickled(item, out);
                out.push('s');
            }
        }
    }
}

#[test]
fn an_openscene_folder_becomes_scene_pictures_and_clips() {
    let folder = tempfile::tempdir().expect("a folder");
    let root = folder.path().join("data");
    let identity = json!([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    let _ = identity;
    // Camera axes in the lidar frame, which is the rig's here, turned by nothing: x right, y down, z ahead.
    let looking = json!([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]);
    let frames: Vec<Value> = (0..9i64)
        .map(|k| {
            let file = format!("log/CAM_F0/{k}.png");
            let path = root.join("sensor_blobs").join(&file);
            std::fs::create_dir_all(path.parent().expect("a folder")).expect("makes");
            let picture = RgbImage::filled(32, 18, [(10 * k) as u8, 9, 9]).encode(Encoding::Png).expect("encodes");
            std::fs::write(path, picture).expect("writes");
            json!({
                "log_name": "2021.log", "timestamp": 5_000_000 + 500_000 * k,
                "ego2global_translation": [600.0 + 4.0 * k as f64, 70.0, 3.0], "ego2global_rotation": [1.0, 0.0, 0.0, 0.0],
                "lidar2ego_translation": [0.0, 0.0, 0.5], "lidar2ego_rotation": [1.0, 0.0, 0.0, 0.0],
                "cams": {"CAM_F0": {"data_path": file, "sensor2lidar_rotation": looking,
                    "sensor2lidar_translation": [1.6, 0.0, 1.0],
                    "cam_intrinsic": [[1545.0, 0.0, 960.0], [0.0, 1545.0, 560.0], [0.0, 0.0, 1.0]],
                    "distortion": [-0.35, 0.1, 0.0, 0.0, 0.0]}},
                "anns": {"gt_boxes": [[15.0, 3.0, 0.4, 4.6, 1.9, 1.7, 0.5], [8.0, -4.0, 0.4, 0.6, 0.6, 1.8, 0.0]],
                    "gt_names": ["vehicle", "pedestrian"], "track_tokens": ["t1", "t2"]}
            })
        })
        .collect();
    let mut text = String::new();
    pickled(&Value::Array(frames), &mut text);
    text.push('.');
    let log = root.join("navsim_logs/mini/2021.log.pkl");
    std::fs::create_dir_all(log.parent().expect("a folder")).expect("makes");
    std::fs::write(&log, text).expect("writes");
    assert_eq!(openscene::logs(&root).expect("finds"), std::slice::from_ref(&log));
    let recorded = openscene::read(&root, &log, None).expect("reads");
    assert!(recorded.warnings.iter().any(|warning| warning.message.contains("no road")), "{:?}", recorded.warnings);
    let scene = &recorded.scene;
    assert_eq!((scene.last_tick().0, scene.dt.secs(), scene.tracks.len()), (8, 0.5, 2));
    let world = scene.logged_world(Tick(3));
    assert!((world.ego.speed_mps() - 8.0).abs() < 0.01, "{}", world.ego.speed_mps());
    let car = world.agents.iter().find(|agent| agent.class == AgentClass::Vehicle).expect("a car");
    let local = world.ego.pose.relative(&car.pose);
    assert!((local.position.x - 15.0).abs() < 0.01 && (local.heading_rad - 0.5).abs() < 0.001, "{local:?}");
    assert!((car.z_m - 0.05).abs() < 0.01, "{}", car.z_m);
    let seen = outline(car, &scene.cameras[0], world.ego.pose.world_from_rig(0.0)).expect("it is ahead");
    assert!(seen[0] < 960.0 - 1545.0 * 0.2 + 200.0 && seen[2] < 960.0, "left of the middle: {seen:?}");
    let recipe = recipe(folder.path(), "openscene", &root, "");
    let out = folder.path().join("out");
    render(&recipe, &out, &Quiet).expect("renders");
    let clip = ClipSet::open(&out).expect("opens").whole(1).expect("reads");
    assert_eq!(clip.frames[0].pixel(3, 3), [40, 9, 9]);
    let short = Recipe { frames: 5, ..recipe };
    let error = render(&short, &folder.path().join("short"), &Quiet).expect_err("two clips of 5 from 9 ticks");
    assert!(error.to_string().contains("9 ticks"), "{error}");
    assert!(ClipPlan::new(&short).is_ok());
}

/// Writes a drive eastwards at 8 m/s along the lane of the drawn map of ds-scenario's tests, and the map beside it.
fn mapped_openscene_folder(root: &Path) -> PathBuf {
    let looking = json!([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]);
    let frames: Vec<Value> = (0..9i64)
        .map(|k| {
            let file = format!("log/CAM_F0/{k}.png");
            let path = root.join("sensor_blobs/mini").join(&file);
            std::fs::create_dir_all(path.parent().expect("a folder")).expect("makes");
            let picture = RgbImage::filled(32, 18, [9, 9, 9]).encode(Encoding::Png).expect("encodes");
            std::fs::write(path, picture).expect("writes");
            json!({
                "log_name": "2021.boston", "map_location": "us-ma-boston", "timestamp": 5_000_000 + 500_000 * k,
                "ego2global_translation": [330_010.0 + 4.0 * k as f64, 4_689_998.25, 3.0],
                "ego2global_rotation": [1.0, 0.0, 0.0, 0.0],
                "lidar2ego_translation": [0.0, 0.0, 0.0], "lidar2ego_rotation": [1.0, 0.0, 0.0, 0.0],
                "traffic_lights": [[201, true]],
                "cams": {"CAM_F0": {"data_path": file, "sensor2lidar_rotation": looking,
                    "sensor2lidar_translation": [1.6, 0.0, 1.5],
                    "cam_intrinsic": [[1545.0, 0.0, 960.0], [0.0, 1545.0, 560.0], [0.0, 0.0, 1.0]],
                    "distortion": [0.0, 0.0, 0.0, 0.0, 0.0]}}
            })
        })
        .collect();
    let mut text = String::new();
    pickled(&Value::Array(frames), &mut text);
    text.push('.');
    let log = root.join("navsim_logs/mini/2021.boston.pkl");
    std::fs::create_dir_all(log.parent().expect("a folder")).expect("makes");
    std::fs::write(&log, text).expect("writes");
    let map = root.join("maps/us-ma-boston/9.12.1817");
    std::fs::create_dir_all(&map).expect("makes");
    let drawn = repository().join("crates/drive/import/tests/data/nuplan-map.gpkg");
    std::fs::copy(drawn, map.join("map.gpkg")).expect("the map is committed");
    log
}

#[test]
fn lanes_of_a_map_beside_the_drives_are_seen_where_they_lie() {
    let folder = tempfile::tempdir().expect("a folder");
    let root = folder.path().join("data");
    let log = mapped_openscene_folder(&root);
    let recorded = openscene::read(&root, &log, None).expect("reads");
    let (scene, world) = (&recorded.scene, recorded.scene.logged_world(Tick(2)));
    assert!(scene.map.lanes.len() > 5 && scene.map.traffic_lights.len() > 1, "{:?}", recorded.warnings);
    let map = StaticMap::new(&scene.map);
    let mut renderer = Renderer::new(LayoutBackend::Cpu).expect("the software rasteriser");
    let camera = &scene.cameras[0];
    let rig = world.ego.pose.world_from_rig(0.0);
    let layout = renderer.render(&LayoutScene { map: &map, world: &world }, camera, rig).expect("renders");
    // What lies ahead and to the left of the rear axle, in metres.
    let seen = |ahead_m: f64, left_m: f64| {
        let camera_from_rig = camera.rig_from_camera.inverse();
        let pixel = camera.intrinsics.project(camera_from_rig * DVec3::new(ahead_m, left_m, 0.0)).expect("it is ahead");
        layout.pixel(pixel.x as u32, pixel.y as u32)
    };
    for (ahead_m, left_m) in [(10.0, 0.8), (20.0, -0.8), (20.0, 2.6), (30.0, 4.3)] {
        assert_eq!(seen(ahead_m, left_m), colour::LANE, "{ahead_m} m ahead, {left_m} m left");
    }
    for left_m in [-11.0, 14.0] {
        assert_eq!(seen(40.0, left_m), colour::GROUND, "{left_m} m left");
    }
    assert_eq!(seen(40.0, 0.0), colour::CENTRE_LINE);
    let more = "maps = \"nowhere\"";
    let recipe = recipe(folder.path(), "openscene", &root, more);
    let error = render(&recipe, &folder.path().join("out"), &Quiet).expect_err("there is no map");
    let reason = std::error::Error::source(&error).map(ToString::to_string).unwrap_or_default();
    assert!(reason.contains("map.gpkg"), "{error}: {reason}");
    let recipe = Recipe { scenarios: ds_clips::ScenarioConfig { maps: None, ..recipe.scenarios.clone() }, ..recipe };
    let out = folder.path().join("out");
    render(&recipe, &out, &Quiet).expect("renders");
    let clip = ClipSet::open(&out).expect("opens").whole(0).expect("reads");
    let lanes = clip.layouts[0].rgb().chunks_exact(3).filter(|pixel| *pixel == colour::LANE).count();
    assert!(lanes > 40, "{lanes} pixels of lanes in the clip");
}

fn matrix(value: &Value) -> (DQuat, DVec3) {
    let at = |i: usize, j: usize| value[i][j].as_f64().expect("a number");
    let column = |j: usize| DVec3::new(at(0, j), at(1, j), at(2, j));
    (DQuat::from_mat3(&DMat3::from_cols(column(0), column(1), column(2))).normalize(), column(3))
}

fn wxyz(q: DQuat) -> Value {
    json!([q.w, q.x, q.y, q.z])
}

/// Writes the real key frame as a nuScenes folder of two equal samples, half a second apart.
fn key_frame_folder(info: &Value, source: &Path, root: &Path) {
    let tables = root.join("v1.0-key");
    let put = |name: &str, rows: Vec<Value>| write(&tables.join(format!("{name}.json")), &Value::Array(rows));
    put("scene", vec![json!({"token": "s", "name": "key", "log_token": "l"})]);
    put("log", vec![json!({"token": "l", "location": "nowhere"})]);
    put("category", vec![json!({"token": "k", "name": "vehicle.car"})]);
    let (ego_rotation, ego_place) = matrix(&info["ego2global"]);
    let (lidar_rotation, lidar_place) = matrix(&info["lidar_points"]["lidar2ego"]);
    let (mut sensors, mut calibrations, mut data, mut poses, mut boxes, mut instances, mut samples) =
        (vec![], vec![], vec![], vec![], vec![], vec![], vec![]);
    for (channel, image) in info["images"].as_object().expect("cameras") {
        let (rotation, place) = matrix(&image["cam2ego"]);
        sensors.push(json!({"token": channel, "channel": channel, "modality": "camera"}));
        calibrations
            .push(json!({"token": format!("c{channel}"), "sensor_token": channel, "translation": place.to_array(),
            "rotation": wxyz(rotation), "camera_intrinsic": image["cam2img"]}));
    }
    for (k, stamp) in [(0, 0), (1, 500_000)] {
        samples.push(json!({"token": format!("s{k}"), "timestamp": stamp, "scene_token": "s"}));
        poses.push(
            json!({"token": format!("p{k}"), "translation": ego_place.to_array(), "rotation": wxyz(ego_rotation)}),
        );
        for (channel, image) in info["images"].as_object().expect("cameras") {
            data.push(json!({"sample_token": format!("s{k}"), "ego_pose_token": format!("p{k}"), "timestamp": stamp,
                "calibrated_sensor_token": format!("c{channel}"), "width": 1600, "height": 900,
                "filename": source.join(image["img_path"].as_str().expect("a name")).display().to_string()}));
        }
        for (i, instance) in info["instances"].as_array().expect("boxes").iter().enumerate() {
            let b: Vec<f64> = instance["bbox_3d"].as_array().expect("a box").iter().filter_map(Value::as_f64).collect();
            let in_ego = lidar_rotation * DVec3::new(b[0], b[1], b[2]) + lidar_place;
            let rotation = ego_rotation * lidar_rotation * DQuat::from_rotation_z(b[6]);
            boxes.push(json!({"sample_token": format!("s{k}"), "instance_token": format!("i{i:02}"),
                "translation": (ego_rotation * in_ego + ego_place).to_array(), "size": [b[4], b[3], b[5]],
                "rotation": wxyz(rotation)}));
            if k == 0 {
                instances.push(json!({"token": format!("i{i:02}"), "category_token": "k"}));
            }
        }
    }
    let rows = [
        ("sensor", sensors),
        ("calibrated_sensor", calibrations),
        ("sample_data", data),
        ("ego_pose", poses),
        ("sample_annotation", boxes),
        ("instance", instances),
        ("sample", samples),
    ];
    rows.into_iter().for_each(|(name, rows)| put(name, rows));
}

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../..")
}

/// Returns a folder of real data, if it is at hand.
fn shared(name: &str) -> Option<PathBuf> {
    let folders = ["../shared/data", "../../shared/data"].map(|up| repository().join(up).join(name));
    let found = folders.into_iter().find(|folder| folder.is_dir());
    if found.is_none() {
        eprintln!("skipped: ../shared/data/{name} is absent");
    }
    found
}

fn overlap(a: [f64; 4], b: [f64; 4]) -> f64 {
    let area = |r: [f64; 4]| (r[2] - r[0]).max(0.0) * (r[3] - r[1]).max(0.0);
    let both = area([a[0].max(b[0]), a[1].max(b[1]), a[2].min(b[2]), a[3].min(b[3])]);
    both / (area(a) + area(b) - both)
}

#[test]
fn boxes_of_the_real_key_frame_lie_on_the_annotated_rectangles() {
    let Some(source) = shared("nuscenes-keyframe-6cam") else { return };
    // Unknown velocities are written as NaN, which JSON does not have.
    let text = std::fs::read_to_string(source.join("info.json")).expect("reads").replace("NaN", "null");
    let info: Value = serde_json::from_str(&text).expect("JSON");
    let folder = tempfile::tempdir().expect("a folder");
    key_frame_folder(&info, &source.canonicalize().expect("a path"), folder.path());
    let recorded = nuscenes::read(folder.path(), "key").expect("reads");
    let (scene, world) = (&recorded.scene, recorded.scene.logged_world(Tick(0)));
    let rig = world.ego.pose.world_from_rig(0.0);
    let (mut overlaps, mut missing) = (Vec::new(), 0);
    for camera in &scene.cameras {
        for annotated in info["cam_instances"][camera.id.as_str()].as_array().expect("boxes") {
            let number = |key: &str, i: usize| annotated[key][i].as_f64().expect("a number");
            // The same thing: the one whose centre lies where the annotation has it in the camera.
            let centre = DVec3::new(number("bbox_3d", 0), number("bbox_3d", 1), number("bbox_3d", 2));
            let to_camera = (rig * camera.rig_from_camera).inverse();
            let middle = |agent: &ds_world::AgentState| {
                (to_camera * agent.pose.position.extend(agent.z_m + 0.5 * agent.size.height_m)).distance(centre)
            };
            let near = world.agents.iter().min_by(|a, b| middle(a).total_cmp(&middle(b))).expect("boxes");
            assert!(middle(near) < 1.5, "{}: no box near {centre}", camera.id);
            let expected = [0, 1, 2, 3].map(|i| number("bbox", i));
            match outline(near, camera, rig) {
                Some(found) => overlaps.push(overlap(found, expected)),
                None => missing += 1,
            }
        }
    }
    overlaps.sort_by(f64::total_cmp);
    let (median, tenth) = (overlaps[overlaps.len() / 2], overlaps[overlaps.len() / 10]);
    eprintln!("{} rectangles, median IoU {median:.3}, tenth percentile {tenth:.3}, {missing} not seen", overlaps.len());
    assert!(overlaps.len() > 60 && missing * 20 < overlaps.len() && median >= 0.7, "median IoU {median:.3}");
    pictures(&recorded, &repository().join("out/real"));
}

/// Draws layouts over the photographs into an ignored folder, to look at.
fn pictures(recorded: &ds_import::Recorded, out: &PathBuf) {
    std::fs::create_dir_all(out).expect("makes");
    let (scene, world) = (&recorded.scene, recorded.scene.logged_world(Tick(0)));
    let map = StaticMap::new(&scene.map);
    let mut renderer = Renderer::new(LayoutBackend::Cpu).expect("the software rasteriser");
    for (camera, pictures) in scene.cameras.iter().zip(&recorded.pictures) {
        let bytes = std::fs::read(pictures[0].as_ref().expect("a picture")).expect("reads");
        let mut photo = RgbImage::photo(&bytes).expect("decodes").reduced(800, 450);
        let small = ds_space::CameraModel { intrinsics: camera.intrinsics.resized(800, 450), ..camera.clone() };
        let layout = LayoutScene { map: &map, world: &world };
        let layout = renderer.render(&layout, &small, world.ego.pose.world_from_rig(0.0)).expect("renders");
        for (photo, layout) in photo.rgb_mut().iter_mut().zip(layout.rgb()) {
            *photo = photo.midpoint(*layout);
        }
        let path = out.join(format!("{}.png", camera.id));
        std::fs::write(path, photo.encode(Encoding::Png).expect("encodes")).expect("writes");
    }
}

#[test]
fn real_logs_of_argoverse_2_are_rendered_like_scenario_files() {
    let Some(logs) = shared("argoverse2") else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let recipe = recipe(folder.path(), "imported", &logs, "");
    let out = folder.path().join("out");
    render(&recipe, &out, &Quiet).expect("renders");
    let set = ClipSet::open(&out).expect("opens");
    assert_eq!(set.len(), 6, "two clips of each of the three logs");
    for clip in (0..set.len()).map(|i| set.whole(i).expect("reads")) {
        for layout in &clip.layouts {
            let colours: BTreeSet<&[u8]> = layout.rgb().chunks_exact(3).collect();
            assert!(colours.len() > 3, "a layout shows {} colours", colours.len());
        }
    }
}

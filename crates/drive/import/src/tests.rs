//! Imports: the six nuScenes drives against their JSON siblings, general map features, folders, hostile pickles.

use std::path::Path;
use std::sync::LazyLock;

use crate::error::ImportError;
use crate::format::{Choice, Format, import_path, open};
use crate::scenarionet;
use crate::writer::Writer;
use ds_space::{DVec2, Tick, plane};
use ds_world::{AgentClass, LaneKind, LightState, Scene, VehicleParameters};
use serde_json::Value as Json;

#[path = "../../../../tests/mutation.rs"]
pub(crate) mod mutation;

const DRIVES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../../shared/data/nuscenes-mini-scenarios");
const SCENES: [&str; 6] = ["0061", "0103", "0553", "0757", "1077", "1094"];

fn drives() -> Option<&'static Path> {
    let folder = Path::new(DRIVES);
    if !folder.is_dir() {
        eprintln!("skipped: {DRIVES} is absent");
        return None;
    }
    Some(folder)
}

fn numbers(json: &Json) -> Vec<f64> {
    json.as_array().expect("a list").iter().map(|value| value.as_f64().expect("a number")).collect()
}

fn points(json: &Json) -> Vec<DVec2> {
    json.as_array().expect("a list").iter().map(numbers).map(|point| DVec2::new(point[0], point[1])).collect()
}

fn compare_tracks(scene: &Scene, json: &Json) {
    let tracks = json["tracks"].as_array().expect("tracks");
    assert_eq!(scene.tracks.len() + 1, tracks.len());
    for expected in tracks {
        let id = expected["id"].as_str().expect("an id");
        let steps: Vec<u32> = expected["steps"]
            .as_array()
            .expect("steps")
            .iter()
            .map(|step| step.as_u64().expect("a tick") as u32)
            .collect();
        let column = |name: &str| numbers(&expected[name]);
        let (x, y, heading) = (column("x"), column("y"), column("heading"));
        if id == "ego" {
            for (i, step) in steps.iter().enumerate() {
                let pose = scene.logged_ego(Tick(*step)).pose;
                assert!((pose.position - DVec2::new(x[i], y[i])).length() < 2e-3, "ego at {step}");
                assert!(ds_space::angle::turn(pose.heading_rad, heading[i]).abs() < 1e-4);
            }
            let size = scene.vehicle.size;
            for (value, name) in [(size.length_m, "length"), (size.width_m, "width"), (size.height_m, "height")] {
                assert!((value - expected[name].as_f64().expect("a size")).abs() < 2e-3, "ego {name} {value}");
            }
            continue;
        }
        let track = scene.tracks.iter().find(|track| track.name == id).expect("every track is imported");
        assert_eq!(track.points.iter().filter(|point| point.is_some()).count(), steps.len());
        let (vx, vy) = (column("vx"), column("vy"));
        for (i, step) in steps.iter().enumerate() {
            let point = track.at(Tick(*step)).expect("valid where the sibling is");
            assert!((point.pose.position - DVec2::new(x[i], y[i])).length() < 2e-3, "{id} at {step}");
            assert!((point.velocity_mps - DVec2::new(vx[i], vy[i])).length() < 3e-3, "{id} at {step}");
        }
        for (value, name) in
            [(track.size.length_m, "length"), (track.size.width_m, "width"), (track.size.height_m, "height")]
        {
            assert!((value - expected[name].as_f64().expect("a size")).abs() < 2e-3, "{id} {name} {value}");
        }
    }
}

fn compare_map(scene: &Scene, json: &Json) {
    let features = json["map_features"].as_array().expect("features");
    let mut lines = scene.map.line_markings.iter();
    for feature in features {
        let expected = points(&feature["polyline"]);
        let kind = feature["type"].as_str().expect("a type");
        let found = if kind.starts_with("LANE") {
            let id = feature["id"].as_str().expect("an id");
            let lane = scene.map.lanes.iter().find(|lane| lane.name == id).expect("every lane is imported");
            assert_eq!(lane.kind == LaneKind::Connector, feature.get("polygon").is_none());
            &lane.centre_line
        } else {
            &lines.next().expect("every line is imported").points
        };
        for point in expected {
            let off_m = found.windows(2).map(|pair| {
                let along = pair[1] - pair[0];
                let share = (along.dot(point - pair[0]) / along.length_squared()).clamp(0.0, 1.0);
                point.distance(pair[0] + along * share)
            });
            let off_m = off_m.fold(f64::INFINITY, f64::min);
            assert!(off_m < 0.02, "{kind} strays by {off_m} m at {point}");
        }
    }
    assert!(lines.next().is_none());
}

#[test]
fn drives_equal_their_json_siblings() {
    let Some(folder) = drives() else { return };
    for name in SCENES {
        let (scene, warnings) = open(&folder.join(format!("sd_nuscenes_v1.0-mini_scene-{name}.pkl"))).expect(name);
        let text = std::fs::read_to_string(folder.join(format!("scene-{name}.json"))).expect("the sibling is there");
        let json: Json = serde_json::from_str(&text).expect("the sibling is JSON");
        assert_eq!(scene.name, format!("scene-{name}"));
        assert_eq!(scene.ego_log.len() as u64, json["n_steps"].as_u64().expect("a count"));
        compare_tracks(&scene, &json);
        compare_map(&scene, &json);
        let said: Vec<String> = warnings.iter().map(ToString::to_string).collect();
        assert!(said.iter().any(|text| text.contains("swapped")), "{said:?}");
        eprintln!("{name}: {said:?}");
    }
}

#[test]
fn drives_are_whole_scenes() {
    let Some(folder) = drives() else { return };
    for name in SCENES {
        let (scene, _) = open(&folder.join(format!("sd_nuscenes_v1.0-mini_scene-{name}.pkl"))).expect(name);
        let on_road = |state: &&ds_world::EgoState| {
            scene.map.drivable.iter().any(|polygon| plane::polygon::holds(polygon, state.pose.position))
        };
        let inside = scene.ego_log.iter().filter(on_road).count();
        assert!(
            inside * 100 >= scene.ego_log.len() * 97,
            "{name}: the rear axle is on the road at {inside} ticks only"
        );
        let linked = |lane: &&ds_world::Lane| !lane.successors.is_empty() && !lane.predecessors.is_empty();
        let connectors: Vec<_> = scene.map.lanes.iter().filter(|lane| lane.kind == LaneKind::Connector).collect();
        let whole = connectors.iter().filter(|lane| linked(lane)).count();
        assert!(
            whole * 100 >= connectors.len() * 85,
            "{name}: {whole} of {} connectors are linked at both ends",
            connectors.len()
        );
        let length_m: f64 = scene.route.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
        let driven_m: f64 =
            scene.ego_log.windows(2).map(|pair| pair[0].pose.position.distance(pair[1].pose.position)).sum();
        assert!(length_m > driven_m + 30.0, "{name}: the route has {length_m} m, the log {driven_m} m");
        let turn = |corner: &[DVec2]| (corner[1] - corner[0]).angle_to(corner[2] - corner[1]).abs();
        let sharpest = scene.route.windows(3).map(turn).fold(0.0, f64::max);
        assert!(sharpest < 0.7, "{name}: the route turns by {sharpest} rad at a point");
        // The drives jump within their last ticks; before, over a second, the speeds add up to the way.
        let sound = &scene.ego_log[..scene.ego_log.len() - 4];
        for second in sound.windows(11) {
            let moved_m = second[0].pose.position.distance(second[10].pose.position);
            let said_m: f64 = second.windows(2).map(|pair| 0.05 * (pair[0].speed_mps() + pair[1].speed_mps())).sum();
            assert!(
                (moved_m - said_m.abs()).abs() < 0.3 + 0.06 * moved_m,
                "{name}: moved {moved_m} m, speed says {said_m} m"
            );
            assert!(second[0].acceleration_mps2.length() < 6.0, "{name}: {:?}", second[0].acceleration_mps2);
        }
        let ends: Vec<f64> = sound[sound.len() - 10..]
            .iter()
            .chain(&scene.ego_log[sound.len()..])
            .map(|state| state.speed_mps())
            .collect();
        let spread = ends.iter().fold(0.0, |most: f64, speed| most.max((speed - ends[0]).abs()));
        assert!(spread < 2.0, "{name}: the speeds at the end are {ends:?}");
        assert!((scene.vehicle.rear_axle_to_centre_m - VehicleParameters::ZOE.rear_axle_to_centre_m).abs() < 0.01);
        eprintln!(
            "{name}: on road {inside}/{}, linked {whole}/{}, route {length_m:.0} m",
            scene.ego_log.len(),
            connectors.len()
        );
    }
}

#[test]
fn a_folder_gives_one_file_for_each_log() {
    let Some(folder) = drives() else { return };
    let out = tempfile::tempdir().expect("a temporary folder can be made");
    let mut heard = 0;
    let results = import_path(Format::ScenarioNet, folder, Choice::default(), out.path(), &mut |_| heard += 1)
        .expect("the folder can be read");
    assert_eq!((results.len(), heard), (6, 6));
    for imported in results {
        let (file, _) = imported.outcome.expect("every drive imports");
        let (scene, _) = ds_scenario::load(&file).expect("imported scenarios load");
        assert_eq!(open(&imported.log).expect("it imported before").0, scene);
    }
}

/// Writes the pickle of a small Waymo-like scene: lanes by name, light, stop sign, edge, crosswalk, odd tracks.
#[expect(clippy::too_many_lines, reason = "one pickle, written from top to bottom")]
fn small(ego_y: impl Fn(u32) -> f64) -> Vec<u8> {
    let mut w = Writer::new();
    let lane = |w: &mut Writer, y: f64, extra: &dyn Fn(&mut Writer)| {
        w.dict(|w| {
            w.text("type").text("LANE_SURFACE_STREET").text("polyline").array(&[2, 3], &[0.0, y, 0.0, 60.0, y, 0.0]);
            w.text("speed_limit_mph").float(30.0);
            extra(w);
        });
    };
    w.dict(|w| {
        w.text("id").text("../small one").text("version").text("1").text("length").int(21);
        w.text("metadata").dict(|w| {
            w.text("sdc_id").text("7").text("dataset").text("waymo");
            w.text("ts").array(&[21], &(0..21).map(|i| f64::from(i) * 0.1).collect::<Vec<_>>());
        });
        w.text("tracks").dict(|w| {
            for (name, kind, y) in [("7", "VEHICLE", 0.0), ("9", "PEDESTRIAN", 6.0), ("10", "UNSET", 9.0)] {
                let path: Vec<f64> =
                    (0..21).flat_map(|i| [f64::from(i), if y == 0.0 { ego_y(i) } else { y }, 0.0]).collect();
                w.text(name).dict(|w| {
                    w.text("type").text(kind).text("state").dict(|w| {
                        w.text("position").array(&[21, 3], &path);
                        w.text("heading").array(&[21], &[0.0; 21]).text("velocity").array(&[21, 2], &[0.0; 42]);
                        w.text("length").array(&[21], &[4.5; 21]).text("width").array(&[21], &[1.9; 21]);
                        w.text("valid").array(&[21], &(0..21).map(|i| f64::from(u8::from(i != 5))).collect::<Vec<_>>());
                    });
                });
            }
        });
        w.text("map_features").dict(|w| {
            w.text("1");
            lane(w, 0.0, &|w| {
                w.text("exit_lanes").list(|w| {
                    w.text("2");
                });
                w.text("left_neighbor").list(|w| {
                    w.dict(|w| {
                        w.text("feature_id").text("3");
                    });
                });
            });
            w.text("2");
            lane(w, 0.1, &|w| {
                w.text("interpolating").int(1);
            });
            w.text("3");
            lane(w, 3.5, &|_| {});
            w.text("e").dict(|w| {
                w.text("type")
                    .text("ROAD_EDGE_BOUNDARY")
                    .text("polyline")
                    .array(&[2, 3], &[0.0, -2.0, 0.0, 60.0, -2.0, 0.0]);
            });
            w.text("y").dict(|w| {
                w.text("type")
                    .text("ROAD_LINE_SOLID_DOUBLE_YELLOW")
                    .text("polyline")
                    .array(&[2, 3], &[0.0, 2.0, 0.0, 60.0, 2.0, 0.0]);
            });
            w.text("c").dict(|w| {
                w.text("type")
                    .text("CROSSWALK")
                    .text("polygon")
                    .array(&[4, 2], &[30.0, -3.0, 33.0, -3.0, 33.0, 6.0, 30.0, 6.0]);
            });
            w.text("s").dict(|w| {
                w.text("type").text("STOP_SIGN").text("position").array(&[3], &[28.0, -2.0, 0.0]);
                w.text("lane").list(|w| {
                    w.text("1");
                });
            });
            w.text("b").dict(|w| {
                w.text("type").text("SPEED_BUMP").text("polygon").array(&[1, 2], &[1.0, 1.0]);
            });
        });
        w.text("dynamic_map_states").dict(|w| {
            w.text("l").dict(|w| {
                w.text("type")
                    .text("TRAFFIC_LIGHT")
                    .text("lane")
                    .text("1")
                    .text("stop_point")
                    .array(&[3], &[29.0, 0.0, 0.0]);
                w.text("state").dict(|w| {
                    w.text("object_state").list(|w| {
                        w.text("LANE_STATE_STOP").text("LANE_STATE_CAUTION").text("LANE_STATE_GO").none();
                    });
                });
            });
        });
    });
    w.done()
}

#[test]
fn other_sources_import_with_lights_links_and_features() {
    let (scene, warnings) = scenarionet::scene(&small(|_| 0.0), Path::new("small.pkl")).expect("it imports");
    assert_eq!(scene.name, "-small-one".to_owned());
    assert_eq!((scene.ego_log.len(), scene.tracks.len(), scene.map.lanes.len()), (21, 1, 3));
    assert_eq!(scene.tracks[0].class, AgentClass::Pedestrian);
    assert!(scene.tracks[0].points[5].is_none() && scene.tracks[0].points[6].is_some());
    let ego = scene.logged_ego(Tick(5)).pose.position;
    assert!((ego.x - (5.0 - scene.vehicle.rear_axle_to_centre_m)).abs() < 2e-3, "{ego}");
    let map = &scene.map;
    assert_eq!(map.lanes[0].successors, [ds_world::LaneId(1)]);
    assert_eq!((map.lanes[0].left, map.lanes[1].kind), (Some(ds_world::LaneId(2)), LaneKind::Connector));
    assert!((map.lanes[0].speed_limit_mps.expect("it has a limit") - 13.411).abs() < 1e-3);
    assert_eq!((map.road_edges.len(), map.crosswalks.len(), map.stop_lines.len(), map.drivable.len()), (1, 1, 2, 3));
    let light = &map.traffic_lights[0];
    assert_eq!(light.states[..4], [LightState::Red, LightState::Yellow, LightState::Green, LightState::Unknown]);
    let said: Vec<String> = warnings.iter().map(ToString::to_string).collect();
    for part in ["SPEED_BUMP", "UNSET", "box centre"] {
        assert!(said.iter().any(|text| text.contains(part)), "{said:?} does not say {part}");
    }
}

#[test]
fn fields_that_do_not_fit_are_named() {
    let refused = |bytes: &[u8], says: &[&str]| {
        let error = scenarionet::scene(bytes, Path::new("bad.pkl")).expect_err(says[0]).to_string();
        assert!(
            says.iter().all(|part| error.contains(part)) && error.contains("bad.pkl"),
            "{error:?} does not say {says:?}"
        );
    };
    refused(&small(|i| if i == 9 { f64::NAN } else { 0.0 }), &["state.position", "[9]", "NaN"]);
    refused(&small(|i| f64::from(i) * 1e8), &["tracks.7.state.position", "[2]", "no place on a map"]);
    refused(&small(|i| f64::from(i) * 1e4), &["tracks.7.state", "position[10]", "from the first"]);
    let mut empty = Writer::new();
    empty.dict(|_| {});
    refused(&empty.done(), &["no \"metadata\""]);
    let mut list = Writer::new();
    list.list(|_| {});
    refused(&list.done(), &["is a list, not a dict"]);
    let mut metadata = Writer::new();
    metadata.dict(|w| {
        w.text("metadata").dict(|w| {
            w.text("sdc_id").text("ghost");
        });
        w.text("tracks").dict(|_| {});
    });
    refused(&metadata.done(), &["\"tracks\"", "no \"ghost\""]);
}

static SMALL: LazyLock<Vec<u8>> = LazyLock::new(|| small(|tick| 0.01 * f64::from(tick)));

#[test]
fn mutated_pickles_are_refused_or_read() {
    mutation::all_are_borne("tests::mutated_pickles_are_refused_or_read", |index| {
        drop(scenarionet::scene(&mutation::bytes(&SMALL, "pickle", index), Path::new("mutated.pkl")));
    });
}

#[test]
fn lines_and_places_beyond_any_map_are_refused_by_name() {
    let far = |from: f64, to: f64| {
        let mut bytes = SMALL.clone();
        let place = bytes.windows(8).position(|eight| eight == from.to_le_bytes()).expect("the number is there");
        bytes[place..place + 8].copy_from_slice(&to.to_le_bytes());
        scenarionet::scene(&bytes, Path::new("far.pkl")).map(|_| ()).expect_err("refused").to_string()
    };
    // the first 60 is the end of a lane, the first 20 that of the drive
    for (from, to, says) in
        [(60.0, 1e308, "no place on a map"), (60.0, 9e7, "at most 100000"), (20.0, 9e7, "from the first")]
    {
        let error = far(from, to);
        assert!(error.contains(says) && error.contains("far.pkl"), "{error}");
    }
}

#[test]
fn a_folder_without_logs_and_a_missing_file_are_errors() {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let import = |path: &Path| import_path(Format::ScenarioNet, path, Choice::default(), folder.path(), &mut |_| ());
    assert!(matches!(import(folder.path()), Err(ImportError::Empty { .. })));
    assert!(matches!(import(&folder.path().join("nowhere.pkl")), Err(ImportError::Read { .. })));
    std::fs::write(folder.path().join("a.pkl"), b"cos\nsystem\n(S'true'\ntR.").expect("it can be written");
    std::fs::write(folder.path().join("b.pkl"), small(|_| 0.0)).expect("it can be written");
    let results = import(folder.path()).expect("a bad log does not stop the others");
    assert!(matches!(results[0].outcome, Err(ImportError::Pickle { .. })) && results[1].outcome.is_ok());
}

//! Imports of CommonRoad: a crossing made by hand, damaged copies of it, and two real scenes where they are at hand.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use ds_scenario::Warning;
use ds_space::{DVec2, Tick, angle, plane};
use ds_world::{AgentClass, LaneId, LaneKind, LightState, LineKind, Scene};

use super::{recorded, scene};
use crate::format::{Choice, Format, import_path, open};
use crate::tests::mutation;

const CROSSING: &str = include_str!("../../tests/data/crossing.commonroad.xml");
const REAL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../../shared/data/commonroad-ngsim");

fn read(ego: Option<&str>) -> (Scene, Vec<Warning>) {
    scene(CROSSING.as_bytes(), Path::new("crossing.xml"), ego).expect("the crossing is sound")
}

fn lane<'a>(scene: &'a Scene, name: &str) -> (LaneId, &'a ds_world::Lane) {
    let at = scene.map.lanes.iter().position(|lane| lane.name == name).expect("the lane is there");
    (LaneId(at as u32), &scene.map.lanes[at])
}

#[test]
fn lanelets_become_lanes_with_links_paint_and_signs() {
    let (scene, warnings) = read(None);
    let names: Vec<&str> = scene.map.lanes.iter().map(|lane| lane.name.as_str()).collect();
    assert_eq!(names, ["1", "2", "3", "11", "12", "14", "21", "22", "24"]);
    let id = |name: &str| lane(&scene, name).0;
    let first = lane(&scene, "1").1;
    assert_eq!(
        (first.centre_line[0], first.centre_line.last()),
        (DVec2::new(-60.0, -1.75), Some(&DVec2::new(0.0, -1.75)))
    );
    assert_eq!((&first.successors, first.left, first.right), (&vec![id("11"), id("12")], None, Some(id("2"))));
    assert_eq!((lane(&scene, "21").1.predecessors[0], lane(&scene, "24").1.left), (id("11"), Some(id("21"))));
    for (name, kind, limit) in
        [("1", LaneKind::Road, Some(13.89)), ("3", LaneKind::Road, None), ("12", LaneKind::Connector, None)]
    {
        assert_eq!((lane(&scene, name).1.kind, lane(&scene, name).1.speed_limit_mps), (kind, limit), "{name}");
    }
    let map = &scene.map;
    assert_eq!((map.junctions.len(), map.crosswalks.len(), map.drivable.len()), (3, 1, 9));
    let count = |kind| map.line_markings.iter().filter(|line| line.kind == kind).count();
    // The line that lanes 1 and 3 share is painted once, as are those between lanes of one direction.
    assert_eq!([LineKind::Double, LineKind::Dashed, LineKind::Solid].map(count), [2, 2, 5]);
    let inside = |point: &DVec2| (point.y + 3.5).abs() < 0.1 && (-59.0..99.0).contains(&point.x);
    assert!(!map.road_edges.iter().flat_map(|edge| &edge.points).any(inside), "no edge between lanes");
    assert!(warnings.iter().any(|warning| warning.to_string().contains("sidewalk")), "{warnings:?}");
}

#[test]
fn lights_follow_their_cycle_and_govern_their_direction() {
    let (scene, _) = read(None);
    let (ahead, left) = (&scene.map.traffic_lights[0], &scene.map.traffic_lights[1]);
    assert_eq!((&ahead.lanes, &left.lanes), (&vec![lane(&scene, "11").0], &vec![lane(&scene, "12").0]));
    // Green 50, yellow 10, red 40 steps, 20 steps late.
    for (tick, state) in [
        (0, LightState::Red),
        (19, LightState::Red),
        (20, LightState::Green),
        (70, LightState::Yellow),
        (80, LightState::Red),
    ] {
        assert_eq!((ahead.at(Tick(tick)), left.at(Tick(tick))), (state, LightState::Red), "{tick}");
    }
    assert!(angle::turn(ahead.facing_rad, std::f64::consts::PI).abs() < 1e-4 && ahead.position.x > 19.0);
    let stops = &scene.map.stop_lines;
    assert_eq!((stops.len(), stops[0].light, stops[1].light), (2, Some(0), None));
    assert_eq!(stops[0].points, [DVec2::new(-1.0, 0.0), DVec2::new(-1.0, -3.5)]);
    assert!(stops[1].points.iter().all(|end| end.x.abs() < 1e-6), "a stop sign stops at the end of its lane");
}

#[test]
fn obstacles_become_tracks() {
    let (scene, _) = read(None);
    let track = |name: &str| scene.tracks.iter().find(|track| track.name == name).expect("the track is there");
    assert_eq!(scene.tracks.len(), 4);
    let car = track("501");
    assert_eq!((car.class, car.size.length_m, car.size.width_m), (AgentClass::Vehicle, 4.6, 1.8));
    let at = car.at(Tick(10)).expect("it is seen");
    assert!(at.pose.position.distance(DVec2::new(-31.0, -5.25)) < 1e-9 && at.velocity_mps == DVec2::new(9.0, 0.0));
    assert!(car.at(Tick(70)).is_some() && car.at(Tick(71)).is_none());
    let bicycle = track("502");
    assert_eq!((bicycle.class, bicycle.points.iter().flatten().count()), (AgentClass::Cyclist, 21));
    assert!(bicycle.at(Tick(9)).is_none() && bicycle.at(Tick(10)).is_some());
    assert!(track("503").points.iter().all(Option::is_some), "what is parked stays");
    assert_eq!((track("504").class, track("504").size.length_m), (AgentClass::Barrier, 1.0));
}

#[test]
fn a_planning_problem_is_drawn_to_its_goal_along_the_lanes() {
    let (scene, warnings) = read(None);
    assert_eq!((scene.name.as_str(), scene.ego_log.len(), scene.dt.secs()), ("ZAM_Crossing-1_1_T-1", 81, 0.1));
    let centre = |tick: u32| scene.logged_ego(Tick(tick)).centre(&scene.vehicle).position;
    assert!(centre(0).distance(DVec2::new(-30.0, -1.75)) < 0.01 && centre(80).distance(DVec2::new(40.0, -5.25)) < 0.01);
    let speeds: Vec<f64> = scene.ego_log.iter().map(|state| state.speed_mps()).collect();
    assert!((speeds[0] - 8.0).abs() < 0.1 && (speeds[80] - 8.0).abs() < 0.1, "{speeds:?}");
    assert!(speeds.iter().all(|speed| (7.0..11.0).contains(speed)), "{speeds:?}");
    assert!(scene.ego_log.iter().all(|state| state.acceleration_mps2.length() < 4.0), "no jolt where lanes meet");
    let on_road = |state: &ds_world::EgoState| {
        state
            .corners(&scene.vehicle)
            .iter()
            .all(|corner| scene.map.drivable.iter().any(|area| plane::polygon::holds(area, *corner)))
    };
    assert!(scene.ego_log.iter().all(on_road));
    let said =
        warnings.iter().any(|warning| warning.to_string().contains("planning problem 900 is drawn, not recorded"));
    assert!(said && scene.origin.source.contains("drawn, not recorded"), "{warnings:?}");
}

#[test]
fn a_goal_that_needs_a_stop_or_has_no_place_is_driven_without_rolling_back() {
    let near = CROSSING.replace("<x>40</x><y>-5.25</y>", "<x>-18</x><y>-1.75</y>");
    let from = near.find("<position><rectangle><length>4</length><width>2</width>").expect("the goal has a place");
    let to = from + near[from..].find("</position>").expect("it ends") + "</position>".len();
    let nowhere = format!("{}{}", &near[..from], &near[to..]);
    let onto = format!("{}<position><lanelet ref=\"21\"/></position>{}", &near[..from], &near[to..]);
    for (text, ends_m) in [(&near, -18.0), (&nowhere, 34.0), (&onto, 60.0)] {
        let (scene, _) = scene(text.as_bytes(), Path::new("near.xml"), None).expect("read");
        let centre = scene.logged_ego(Tick(80)).centre(&scene.vehicle).position;
        assert!((centre.x - ends_m).abs() < 0.5, "{centre}");
        assert!(scene.ego_log.windows(2).all(|pair| pair[1].pose.position.x >= pair[0].pose.position.x - 1e-6));
    }
}

#[test]
fn a_recorded_vehicle_can_be_the_ego() {
    let (scene, warnings) = read(Some("501"));
    assert_eq!((scene.name.as_str(), scene.recording()), ("ZAM_Crossing-1_1_T-1-ego501", "ZAM_Crossing-1_1_T-1"));
    assert_eq!((scene.ego_log.len(), scene.tracks.len(), scene.vehicle.size.length_m), (71, 3, 4.6));
    for tick in [0, 35, 70] {
        let state = scene.logged_ego(Tick(tick));
        let centre = state.centre(&scene.vehicle).position;
        assert!(centre.distance(DVec2::new(-40.0 + 0.9 * f64::from(tick), -5.25)) < 1e-6, "{centre}");
        assert!((state.speed_mps() - 9.0).abs() < 1e-6);
    }
    assert!(!warnings.iter().any(|warning| warning.to_string().contains("drawn")), "{warnings:?}");
    assert_eq!(recorded(CROSSING.as_bytes(), Path::new("crossing.xml")).expect("one"), ["501"]);
    for (what, by, says) in [
        ("<x>60</x><y>-6</y>", "<x>10</x><y>-6</y>", "touches 1 of the tracks, first \"503\" at tick 51"),
        (
            "<time><exact>70</exact></time>",
            "<time><exact>80</exact></time>",
            "501 is not seen at 10 ticks, filled between",
        ),
    ] {
        let text = CROSSING.replacen(what, by, 1);
        let (_, warnings) = super::scene(text.as_bytes(), Path::new("odd.xml"), Some("501")).expect("odd, but sound");
        assert!(warnings.iter().any(|warning| warning.to_string().contains(says)), "{warnings:?}");
    }
    let error = super::scene(CROSSING.as_bytes(), Path::new("crossing.xml"), Some("503")).expect_err("it is parked");
    assert!(error.to_string().contains("no recorded vehicle \"503\""), "{error}");
    let without = CROSSING.replace("planningProblem", "problem");
    let (scene, _) =
        super::scene(without.as_bytes(), Path::new("crossing.xml"), None).expect("who drives longest drives");
    assert_eq!(scene.ego_log.len(), 71);
}

#[test]
fn other_time_steps_are_laid_on_ticks() {
    for (secs, ego_ticks, stride) in [("0.04", 33, 2.5), ("0.2", 161, 0.5), ("0.1", 81, 1.0)] {
        let text = CROSSING.replace("timeStepSize=\"0.1\"", &format!("timeStepSize=\"{secs}\""));
        let (drawn, warnings) = scene(text.as_bytes(), Path::new("steps.xml"), None).expect("read");
        assert_eq!((drawn.dt.secs(), drawn.ego_log.len()), (0.1, ego_ticks), "{secs}");
        let car = drawn.tracks.iter().find(|track| track.name == "501").expect("it is a track");
        let at = |tick: u32| car.at(Tick(tick)).expect("it is seen").pose.position.x;
        assert!(
            (at(0) + 40.0).abs() < 1e-6 && (at(7) - at(6) - 0.9 * stride).abs() < 2e-3,
            "{secs}: {}",
            at(7) - at(6)
        );
        assert_eq!(car.points.iter().flatten().count(), (70.0 / stride) as usize + 1);
        assert_eq!(warnings.iter().any(|warning| warning.to_string().contains("interpolated")), secs != "0.1");
    }
    // Green 50 steps of 0.2 s, 20 steps late.
    let slow = CROSSING.replace("timeStepSize=\"0.1\"", "timeStepSize=\"0.2\"");
    let light = &scene(slow.as_bytes(), Path::new("slow.xml"), None).expect("read").0.map.traffic_lights[0];
    assert_eq!(
        [39, 40, 139, 140].map(|tick| light.at(Tick(tick))),
        [LightState::Red, LightState::Green, LightState::Green, LightState::Yellow]
    );
}

#[test]
fn damaged_files_are_refused_by_element() {
    let bomb = "<!DOCTYPE a [<!ENTITY b \"bbbbbbbbbb\"><!ENTITY c \"&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;\">]><commonRoad";
    let deep = format!("{}{}", "<a>".repeat(40), "</a>".repeat(40));
    for (what, by, says) in [
        ("\"2020a\"", "\"2017a\"", "commonRoad\" has commonRoadVersion \"2017a\"; 2018b and 2020a are read"),
        ("timeStepSize=\"0.1\"", "timeStepSize=\"-1\"", "timeStepSize \"-1\""),
        ("timeStepSize=\"0.1\"", "", "has no attribute \"timeStepSize\""),
        ("<x>-60</x>", "<x>NaN</x>", "lanelet[1].leftBound.point[0].x\" is NaN, no number within"),
        ("<x>-60</x>", "<x>1e300</x>", "is 1e300, no number within"),
        ("<x>-60</x>", "<x>9e7</x>", "lanelet[1].leftBound.point[0]\" lies more than 100000 m"),
        ("<x>-60</x>", "<x>west</x>", "is \"west\", no number"),
        ("<x>-60</x>", "", "has no \"x\""),
        ("<leftBound>", "<leftBund>", "is no sound XML"),
        ("<point><x>-60</x><y>0</y></point>", "", "lanelet[1].leftBound\" has 1 points"),
        (
            "<point><x>-60</x><y>0</y></point>",
            "<point><x>0</x><y>0</y></point>",
            "lanelet[1]\" has a bound without length",
        ),
        ("<lanelet id=\"2\">", "<lanelet id=\"1\">", "\"1\" is the name of map.lanes[0] too"),
        ("<successor ref=\"11\"/>", "<successor/>", "has no attribute \"ref\""),
        ("<color>green</color>", "<color>mauve</color>", "no colour of a traffic light"),
        ("<duration>50</duration>", "<duration>-50</duration>", "is -50, no whole time step"),
        ("<length>4.6</length>", "<length>0</length>", "dynamicObstacle[501].shape\" is 0 m long"),
        ("<time><exact>5</exact></time>", "<time><exact>4</exact></time>", "is of time step 4, as one before it"),
        ("<time><exact>5</exact></time>", "<time><exact>9e7</exact></time>", "no whole time step from 0 to 1000000"),
        ("<intervalStart>75</intervalStart><intervalEnd>80</intervalEnd>", "<exact>0</exact>", "ends at step 0"),
        ("<intervalEnd>80</intervalEnd>", "<intervalEnd>900000</intervalEnd>", "1 to 19999 are read"),
        ("<velocity><exact>8</exact></velocity>", "", "planningProblem[900].initialState\" has no \"velocity\""),
        ("<orientation><exact>0</exact></orientation>", "", "has no \"orientation\""),
        ("<commonRoad", "<osm", "is no sound XML"),
        ("<commonRoad", bomb, "declares a document type"),
        ("</commonRoad>", "", "is no sound XML"),
        ("<location>", &deep, "one in another"),
    ] {
        assert!(CROSSING.contains(what), "{what}");
        let damaged = CROSSING.replacen(what, by, 1);
        let error = scene(damaged.as_bytes(), Path::new("bad.xml"), None).expect_err(says).to_string();
        assert!(error.contains(says) && error.contains("bad.xml"), "{error:?} does not say {says:?}");
    }
    for text in ["", "<commonRoad", "<osm></osm>", "\u{0}\u{0}"] {
        scene(text.as_bytes(), Path::new("bad.xml"), None).expect_err("no scene");
    }
}

/// The crossing with one in ten of its states, so that changes meet other elements too.
static SPARSE: LazyLock<String> = LazyLock::new(|| {
    let kept = |line: &&str| !line.contains("<state>") || line.contains("0</exact></time>");
    CROSSING.lines().filter(kept).collect::<Vec<_>>().join("\n")
});

#[test]
fn mutated_files_are_refused_or_read() {
    mutation::all_are_borne("commonroad::tests::mutated_files_are_refused_or_read", |index| {
        let bytes = mutation::text(&SPARSE, "commonroad", index);
        let ego = if index.is_multiple_of(2) { Some("501") } else { None };
        drop(scene(&bytes, Path::new("mutated.xml"), ego));
        drop(recorded(&bytes, Path::new("mutated.xml")));
    });
}

#[test]
fn folders_are_imported_whole_and_other_xml_is_none_of_ours() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("out");
    for (name, text) in [("a.xml", CROSSING), ("b.xml", "<commonRoad commonRoadVersion=\"1\"/>"), ("c.xml", "<osm/>")] {
        std::fs::write(folder.path().join(name), text).expect("it can be written");
    }
    assert_eq!(Format::of(&folder.path().join("a.xml")), Some(Format::CommonRoad));
    assert_eq!(Format::of(&folder.path().join("c.xml")), None);
    assert_eq!(open(&folder.path().join("a.xml")).expect("it opens").0.ego_log.len(), 81);
    for (ego, files) in [(None, 1), (Some(Choice::RECORDED), 1), (Some("501"), 1)] {
        let choice = Choice { ego, ..Choice::default() };
        let results = import_path(Format::CommonRoad, folder.path(), choice, &out, &mut |_| ()).expect("lists");
        assert_eq!(results.len(), 2);
        assert_eq!(results.iter().filter(|imported| imported.outcome.is_ok()).count(), files);
        let error = results[1].outcome.as_ref().expect_err("the version is wrong").to_string();
        assert!(error.contains("b.xml"), "{error}");
    }
}

/// Ids and counts as the files themselves have them.
#[test]
fn recorded_scenes_of_ngsim_are_imported() {
    let folder = Path::new(REAL);
    if !folder.is_dir() {
        eprintln!("skipped: {REAL} is absent");
        return;
    }
    let file = |name: &str| -> (PathBuf, Vec<u8>) {
        let path = folder.join(name);
        let bytes = std::fs::read(&path).expect("it can be read");
        (path, bytes)
    };
    for (name, lanes, tracks, ticks, egos, id) in
        [("USA_US101-4_1_T-1.xml", 12, 22, 101, 16, "427"), ("USA_Lanker-1_1_T-1.xml", 91, 24, 41, 22, "1213")]
    {
        let (path, bytes) = file(name);
        let (drawn, _) = scene(&bytes, &path, None).expect(name);
        assert_eq!((drawn.map.lanes.len(), drawn.tracks.len(), drawn.ego_log.len()), (lanes, tracks, ticks), "{name}");
        assert!(drawn.logged_ego(Tick(0)).centre(&drawn.vehicle).position.length() < 0.01, "{name}");
        assert_eq!(recorded(&bytes, &path).expect(name).len(), egos, "{name}");
        let (driven, _) = scene(&bytes, &path, Some(id)).expect(name);
        let track = drawn.tracks.iter().find(|track| track.name == id).expect("it is a track of the other");
        for tick in 0..driven.ego_log.len() as u32 {
            let said = track.at(Tick(tick)).expect("it is seen throughout").pose.position;
            let driven = driven.logged_ego(Tick(tick)).centre(&driven.vehicle).position;
            assert!(driven.distance(said) < 2e-3, "{name} at {tick}: {driven}, {said}");
        }
    }
}

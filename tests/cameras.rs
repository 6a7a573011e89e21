//! Cameras of any size: the part of the image that the video model sees is cut out before anything is drawn, every stage
//! sees the same calibration, and the recording keeps both.

use std::path::Path;

use crate::harness::{Drive, drive, workspace};
use ds_record::Recording;
use ds_space::{DVec3, Tick};
use serde_json::{Value, json};

/// Name, size, focal length, centre and distortion.
type Camera = (&'static str, [u32; 2], f64, [f64; 2], [f64; 2]);

const CAMERAS: [Camera; 3] = [
    ("portrait", [1550, 2048], 1686.0, [775.0, 1100.0], [-0.24, -0.21]),
    ("uhd", [3840, 2160], 2200.0, [1920.0, 1080.0], [0.0, 0.0]),
    ("wide", [1280, 960], 500.0, [640.0, 480.0], [-0.15, 0.02]),
];
const SHORT: [&str; 4] = ["--duration", "1", "--policy", "camera"];

/// Writes the shipped curve as seen by other cameras, one file each.
fn scenarios(folder: &Path) -> Vec<String> {
    let shipped = workspace().join("scenarios/base/free-curve.scenario.json");
    let shipped: Value =
        serde_json::from_str(&std::fs::read_to_string(shipped).expect("a scenario")).expect("a scenario is JSON");
    let write = |(name, size, focal, centre, distortion): &Camera| {
        let mut scenario = shipped.clone();
        scenario["name"] = json!(name);
        let camera = &mut scenario["cameras"][0];
        for (key, value) in [
            ("width_px", json!(size[0])),
            ("height_px", json!(size[1])),
            ("fx_px", json!(focal)),
            ("fy_px", json!(focal)),
            ("cx_px", json!(centre[0])),
            ("cy_px", json!(centre[1])),
            ("k1", json!(distortion[0])),
            ("k2", json!(distortion[1])),
        ] {
            camera[key] = value;
        }
        let path = folder.join(format!("{name}.scenario.json"));
        std::fs::write(&path, scenario.to_string()).expect("writes");
        path.display().to_string()
    };
    CAMERAS.iter().map(write).collect()
}

fn driven(scenarios: &[String], extra: &[&str]) -> Drive {
    let files: Vec<&str> = scenarios.iter().map(String::as_str).collect();
    drive(&[&files[..], &SHORT[..], extra].concat())
}

#[test]
fn generated_frames_have_one_calibration_at_every_stage() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let scenarios = scenarios(folder.path());
    let (drive, processes) = (driven(&scenarios, &[]), driven(&scenarios, &["--processes"]));
    for (index, (name, size, ..)) in CAMERAS.iter().enumerate() {
        assert_eq!(drive.episode(index)["status"], "completed", "{name}");
        let recording = Recording::open(&drive.recording(index)).expect("a recording");
        let message = recording.scene();
        let (camera, original) = (&message.scene.cameras[0].intrinsics, &message.originals[0]);
        assert_eq!([original.width_px, original.height_px], *size, "{name}");
        let moment = recording.moment(Tick(5)).expect("a moment");
        for image in [&moment.frames[0], &moment.layouts[0], &message.first_frames[0]] {
            assert_eq!([image.width_px(), image.height_px()], [camera.width_px, camera.height_px], "{name}");
        }
        // a point lands in the layout where its place in the original image says
        let point = DVec3::new(0.8, 0.5, 12.0);
        let (at, before) = (camera.project(point).expect("ahead"), original.project(point).expect("ahead"));
        let framing = original.framing([camera.width_px, camera.height_px]);
        let scale = f64::from(camera.width_px) / f64::from(framing.width_px);
        assert!((at.x - (before.x - f64::from(framing.left_px)) * scale).abs() < 0.2, "{name}: {at} {before}");
        assert_eq!(drive.digests(index), processes.digests(index), "{name}: processes");
    }
}

#[test]
fn cameras_that_fit_and_sources_without_a_model_keep_their_own() {
    let shipped = drive(&[&["scenarios/base/free-curve.scenario.json"], &SHORT[..]].concat());
    let recording = Recording::open(&shipped.recording(0)).expect("a recording");
    assert!(recording.scene().originals.is_empty(), "the shipped camera has the size of the shipped model");

    let folder = tempfile::tempdir().expect("a temporary folder");
    let wide = scenarios(folder.path()).pop().expect("three of them");
    let layout = driven(&[wide], &["--observation", "layout"]);
    let recording = Recording::open(&layout.recording(0)).expect("a recording");
    assert!(recording.scene().originals.is_empty());
    assert_eq!(recording.scene().scene.cameras[0].intrinsics.width_px, 1280);
    assert_eq!(recording.moment(Tick(2)).expect("a moment").frames[0].width_px(), 1280);
}

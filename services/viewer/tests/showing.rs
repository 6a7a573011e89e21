//! Recordings, drives, diagnoses and trainings become data of the viewer; what was drawn is looked for in the results.
//!
//! The files stay in the target folder (`tmp/showing`) for a look.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::LazyLock;

use ds_effect::Verdict;
use ds_record::viewing::{Along, Curve, Explained};
use ds_record::{Recorder, Recording};
use ds_space::{SimTime, Tick};
use ds_topic::{DiagnosedEffect, Diagnosis, GapCell, Slot, Topic};
use viewer::LiveView;
use viewer::recording::save_rrd;

#[path = "../../../crates/protocol/record/tests/fixture/drive.rs"]
mod drive;
use drive::{Drive, completed};

const LAST_TICK: u32 = 30;

fn folder() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("showing");
    fs::create_dir_all(&folder).expect("the target folder is writable");
    folder
}

/// A recorded drive.
static RECORDING: LazyLock<PathBuf> = LazyLock::new(|| {
    let drive = Drive::new(&["front"], LAST_TICK);
    let path = folder().join("drive.mcap");
    drive.record(&path, drive.iterations()).finish(&completed()).expect("finishes");
    path
});

#[test]
fn the_viewer_file_holds_every_entity() {
    let path = folder().join("drive.rrd");
    let mut process = Command::new(env!("CARGO_BIN_EXE_viewer"));
    let said = process.arg("recording").arg(&*RECORDING).arg("--save").arg(&path).output().expect("starts");
    assert!(said.status.success(), "{}", String::from_utf8_lossy(&said.stderr));
    let bytes = fs::read(&path).expect("is there");
    assert!(bytes.starts_with(b"RRF2"), "begins with {:?}", &bytes[..4]);
    for entity in
        ["/world/agents", "/world/ego/body", "/world/plan/answer", "/camera/front/frame/boxes", "/score/progress"]
    {
        let found = bytes.windows(entity.len()).any(|window| window == entity.as_bytes());
        assert!(found, "{entity} is not in the file");
    }
}

/// Says which of some texts the bytes do not hold.
fn lacking<'a>(bytes: &[u8], texts: &[&'a str]) -> Vec<&'a str> {
    let held = |text: &str| bytes.windows(text.len()).any(|window| window == text.as_bytes());
    texts.iter().copied().filter(|text| !held(text)).collect()
}

fn effect(id: &str, probability: f64, chosen: bool) -> DiagnosedEffect {
    let interval90 = [Some(0.018), Some(0.022)];
    DiagnosedEffect { id: id.to_owned(), probability, value: Some(0.02), unit: "rad/s".to_owned(), interval90, chosen }
}

fn diagnosis(tick: Tick) -> Diagnosis {
    let cell = GapCell { channel: "yaw_rate".to_owned(), bins: Vec::new(), effect_size: 4.0, q_value: Some(0.001) };
    Diagnosis {
        window: (SimTime(0), SimTime(100_000_000 * i64::from(tick.0))),
        reference: String::new(),
        verdict: Verdict::Single,
        p_none: 0.05,
        p_unknown: 0.05,
        effects: vec![effect("gyro_bias", 0.9, true), effect("steer_gain", 0.001, false)],
        cells: vec![cell],
        differences: vec![("position".to_owned(), 0.4)],
    }
}

#[test]
fn diagnoses_beside_a_drive_are_recorded_and_shown() {
    let drive = Drive::new(&["front"], LAST_TICK);
    let path = folder().join("diagnosed.mcap");
    let mut recorder = Recorder::create(&path, &drive.scene()).expect("creates");
    for iteration in 0..drive.iterations() {
        recorder.append(&drive.iteration(iteration)).expect("takes the messages");
        let tick = Tick(5 * iteration);
        let slot = Slot::new(Topic::Diagnosis, tick.0);
        recorder.append(&[drive.envelope(slot, tick, iteration, &diagnosis(tick))]).expect("takes a diagnosis");
        recorder.commit(iteration).expect("commits");
    }
    recorder.finish(&completed()).expect("finishes");
    let recording = Recording::open(&path).expect("opens");
    assert!(recording.missing().expect("orders decode").is_empty());
    assert_eq!(recording.topic(Topic::Diagnosis).count(), drive.iterations() as usize);
    assert_eq!(recording.body::<Diagnosis>(Slot::new(Topic::Diagnosis, 10)).expect("is there"), diagnosis(Tick(10)));
    let rrd = folder().join("diagnosed.rrd");
    save_rrd(&recording, &rrd).expect("writes");
    let bytes = fs::read(&rrd).expect("is there");
    let entities = [
        "/diagnosis/verdict",
        "/diagnosis/where",
        "/diagnosis/effects/gyro_bias/probability",
        "/diagnosis/effects/gyro_bias/value",
        "/diagnosis/differences/position",
    ];
    assert!(lacking(&bytes, &entities).is_empty(), "{:?}", lacking(&bytes, &entities));
    let unlikely = "/diagnosis/effects/steer_gain/value";
    assert_eq!(lacking(&bytes, &[unlikely]), [unlikely], "an effect that nobody suspects has a curve");
}

#[test]
fn a_finished_diagnosis_becomes_a_viewer_file() {
    let moment = |k: u32| [f64::from(k) * 0.25, 0.5 + 0.01 * f64::from(k), 0.1, 0.08];
    let curve = |name: &str| Curve::new(name.to_owned(), (0..40).map(moment));
    let path = (0..40).map(|k| [f64::from(k) * 0.25, f64::from(k) * 2.0, 0.0]).collect();
    let drives = vec![Along { drive: 3, path, curves: vec![curve("position_2s"), curve("yaw_rate")] }];
    let effects = [effect("gyro_bias", 0.9, true)];
    let explained = Explained::new("case_01", "one effect".to_owned(), &effects, &diagnosis(Tick(0)).cells);
    let explained = Explained { drives, ..explained };
    let rrd = folder().join("explained.rrd");
    let process = Command::new(env!("CARGO_BIN_EXE_viewer")).arg("diagnosis").arg(&rrd).stdin(Stdio::piped()).spawn();
    let mut process = process.expect("starts");
    serde_json::to_writer(process.stdin.take().expect("a pipe"), &explained).expect("takes it");
    assert!(process.wait().expect("ends").success());
    let bytes = fs::read(&rrd).expect("is there");
    let entities = [
        "/diagnosis/ranking",
        "/diagnosis/where",
        "/diagnosis/effects/gyro_bias/low",
        "/drive_3/road/before",
        "/drive_3/road/after",
        "/drive_3/residual/position_2s/before",
        "/drive_3/residual/yaw_rate/floor",
    ];
    assert!(lacking(&bytes, &entities).is_empty(), "{:?}", lacking(&bytes, &entities));
}

#[test]
fn a_live_view_shows_what_it_takes_and_counts_what_it_drops() {
    let drive = Drive::new(&["front"], LAST_TICK);
    let (stream, storage) = rerun::RecordingStreamBuilder::new("test").memory().expect("a stream in memory");
    let live = LiveView::start(drive.message(), stream, 4, &[]).expect("starts");
    let (mut taken, mut fed) = (0, 0);
    for iteration in 0..drive.iterations() {
        for envelope in drive.iteration(iteration) {
            taken += u64::from(live.feed(envelope));
            fed += 1;
        }
    }
    let mut broken = drive.iteration(0)[1].clone();
    broken.body = bytes::Bytes::from_static(b"\xff");
    while !live.feed(broken.clone()) {
        fed += 1;
    }
    fed += 1;
    let shown = live.finish().expect("the stream holds");
    assert_eq!((shown.logged, shown.refused), (taken, 1));
    assert_eq!(shown.logged + shown.refused + shown.dropped, fed);
    assert!(!storage.take().is_empty());
}

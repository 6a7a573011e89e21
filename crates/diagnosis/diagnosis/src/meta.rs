//! `meta.json` of a case: what kind it is, which files it has, which of them are for fitting, and the nominal simulator
//! that the user has. The same types read and write it.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::json;

mod frames;
mod traffic;
mod vehicle;

pub use frames::{FrameMeta, FrameSplit, Pairing, PinholeEntry};
pub use traffic::{Drivers, HeldOut, RecordingEntry, TRAFFIC, TrafficMeta};
pub use vehicle::{CameraEntry, DriveEntry, Idm, Nominal, SINGLE_TRACK, Split, VehicleMeta};

/// The file.
pub const FILE: &str = "meta.json";

/// Who takes a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Logs of a vehicle.
    Vehicle,
    /// Two streams of frames.
    Frames,
    /// Recorded traffic with its scenes.
    Traffic,
}

#[derive(Default, Deserialize)]
struct Hints {
    #[serde(default)]
    model: String,
    #[serde(default)]
    seeds: Vec<PathBuf>,
    #[serde(default)]
    clips: Vec<PathBuf>,
}

impl Kind {
    /// Tells the kind of a case folder; what is neither traffic nor frames is taken for logs of a vehicle.
    #[must_use]
    pub fn of(case: &Path) -> Self {
        let meta = case.join(FILE);
        let hints = json::read::<Hints>(&meta).unwrap_or_default();
        if hints.model == TRAFFIC {
            return Self::Traffic;
        }
        let paired = meta.is_file() && case.join("sim").is_dir() && case.join("real").is_dir();
        let frames = paired || !hints.seeds.is_empty() || !hints.clips.is_empty();
        if frames { Self::Frames } else { Self::Vehicle }
    }
}

/// Returns the name of a folder, as which a case without a name goes.
pub(crate) fn name_of(case: &Path) -> String {
    case.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_told_apart_and_descriptions_come_back() {
        let root = tempfile::tempdir().expect("a folder");
        let [van, eye, road] = ["van", "eye", "road"].map(|name| root.path().join(name));
        let traffic = TrafficMeta {
            recordings: vec![RecordingEntry { scene: "a.json".into(), tracks: Some("a.csv".into()), from_secs: 0.5 }],
            nominal: Drivers { headway: Some(1.0 / 3.0), interactive: Some(false), ..Drivers::default() },
            suggested_split: Some(HeldOut { held_out: vec![3] }),
            ..TrafficMeta::default()
        };
        traffic.write(&road).expect("it can be written");
        assert_eq!(TrafficMeta { case: "road".to_owned(), ..traffic }, TrafficMeta::read(&road).expect("readable"));
        let pinhole = PinholeEntry { fx: 90.1, fy: 90.2, cx: 79.5, cy: 47.5 };
        let frames = FrameMeta {
            case: "dusk".to_owned(),
            suggested_split: Some(FrameSplit { fit: Some([0, 7]), held_out: [8, 9] }),
            pairing: Some(Pairing::SameLayout),
            camera_height_m: Some(1.5),
            ..FrameMeta::new([160, 96], 10.0, pinhole)
        };
        frames.write(&eye).expect("it can be written");
        assert_eq!(frames, FrameMeta::read(&eye).expect("readable"));
        for stream in ["sim", "real"] {
            std::fs::create_dir(eye.join(stream)).expect("a folder");
        }
        assert_eq!([van, eye, road].map(|case| Kind::of(&case)), [Kind::Vehicle, Kind::Frames, Kind::Traffic]);
    }

    #[test]
    fn damage_is_refused_by_its_key() {
        let refused = |error: crate::CaseError| match error {
            crate::CaseError::Json { source, .. } => source.to_string(),
            other => panic!("{other}"),
        };
        let folder = tempfile::tempdir().expect("a folder");
        let put = |text: &str| std::fs::write(folder.path().join(FILE), text).expect("it can be written");
        put(r#"{"model":"traffic","recordings":[{"scene":"a","from_secs":"soon"}]}"#);
        assert!(refused(TrafficMeta::read(folder.path()).expect_err("no number")).contains("recordings[0].from_secs"));
        put(r#"{"width":160,"height":96,"frame_rate_hz":10,"intrinsics":{"fx":1,"fy":1,"cx":1,"cy":null}}"#);
        assert!(refused(FrameMeta::read(folder.path()).expect_err("no number")).contains("intrinsics.cy"));
    }
}

//! The labelled practice cases: verdicts and first effects, with stated minimum figures.

use std::collections::BTreeMap;
use std::path::PathBuf;

use ds_diagnosis::Verdict;
use ds_frames::{FrameCase, Options, diagnose};

#[test]
fn practice_cases_reach_their_minimum() {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../../shared/data/gap-camera-practice");
    if !folder.join("labels.json").exists() {
        eprintln!("skipped: the practice cases are not at {}", folder.display());
        return;
    }
    let labels: BTreeMap<String, serde_json::Value> =
        serde_json::from_str(&std::fs::read_to_string(folder.join("labels.json")).expect("labels")).expect("labels");
    let (mut first, mut alarms) = (0, 0);
    for (name, label) in &labels {
        let found =
            diagnose(&FrameCase::read(&folder.join(name)).expect("a case"), &Options::default()).expect("a diagnosis");
        match label["kind"].as_str() {
            Some("single") => {
                first += usize::from(found.effects.first().is_some_and(|e| label["effects"][0]["id"] == *e.id));
            }
            Some("none") => alarms += usize::from(found.verdict != Verdict::None),
            _ => {}
        }
    }
    assert_eq!((first, alarms), (6, 0), "singles with the right first effect, false alarms");
}

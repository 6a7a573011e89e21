//! Quirks of the sampling that every healthy log of a vehicle has are no fault against their baseline; those that a case alone
//! has are, and so is more of them. Reverse driving, which the simulator cannot, is left out and said.

use std::path::Path;
use std::sync::Arc;

use ds_diagnosis::{Diagnosis, Verdict};
use ds_dynamics::baseline::Baseline;
use ds_dynamics::case::Case;
use ds_dynamics::healthy::{Healthy, learn};
use ds_dynamics::{Options, diagnose, synthetic};

use crate::rows::change;

/// What is done to the rows of a log, cell by cell with the head in front.
type Edit = fn(&mut [Vec<String>]);

const PLAIN: Edit = |_| ();

/// Keeps each pose for a second row, as a receiver of half the rate does.
const HELD: Edit = |rows| {
    let pose: Vec<usize> = rows[0]
        .iter()
        .enumerate()
        .filter(|(_, name)| ["x", "y", "yaw", "v"].contains(&name.as_str()))
        .map(|c| c.0)
        .collect();
    for k in (2..rows.len()).step_by(2) {
        pose.iter().for_each(|at| rows[k][*at] = rows[k - 1][*at].clone());
    }
};

/// Drives backwards for a while.
const BACKWARDS: Edit = |rows| {
    for name in ["v", "v_wheel"] {
        let at = rows[0].iter().position(|column| column == name).expect("the column is there");
        rows[300..420].iter_mut().for_each(|row| row[at] = format!("-{}", row[at]));
    }
};

fn case(folder: &Path, seed: u64, jitter_secs: f64, edit: Edit) -> Case {
    synthetic::write_case(folder, seed, &|plant| plant.clock.jitter_secs = jitter_secs)
        .expect("the case can be written");
    for drive in 0..4 {
        let path = folder.join(format!("drive_{drive}.csv"));
        change(&path, |rows| edit(rows));
    }
    Case::read(folder).expect("the case can be read")
}

fn baseline(jitter_secs: f64, edit: Edit) -> Arc<Baseline> {
    let root = tempfile::tempdir().expect("a folder");
    let one = |seed: u64| {
        let name = format!("day-{seed}");
        Healthy { case: case(&root.path().join(&name), seed, jitter_secs, edit), name }
    };
    Arc::new(learn(&[61, 62, 63].map(one), &|| ()).expect("three healthy logs"))
}

fn found(baseline: Option<&Arc<Baseline>>, jitter_secs: f64, edit: Edit) -> Diagnosis {
    let root = tempfile::tempdir().expect("a folder");
    let case = case(root.path(), 71, jitter_secs, edit);
    let case = match baseline {
        Some(baseline) => case.against(baseline.clone()).expect("a baseline of this vehicle"),
        None => case,
    };
    diagnose(&case, &Options { quick: true, ..Options::default() })
}

#[test]
fn jitter_of_all_logs_is_no_fault_and_more_of_it_is() {
    let (plain, jittery) = (baseline(0.0, PLAIN), baseline(0.005, PLAIN));
    for (baseline, jitter_secs, expected) in [
        (None, 0.005, Some(0.005)),
        (Some(&jittery), 0.005, None),
        (Some(&jittery), 0.015, Some(0.0141)),
        (Some(&plain), 0.005, Some(0.005)),
        (Some(&plain), 0.0, None),
    ] {
        let found = found(baseline, jitter_secs, PLAIN);
        let value = found.effects.iter().find(|e| found.chosen == [e.id.as_str()] && e.id == "timestamp_jitter");
        assert_eq!(value.is_some(), expected.is_some(), "{jitter_secs} s: {:?}", found.chosen);
        let close = |(value, expected): (f64, f64)| (value - expected).abs() < 0.15 * expected;
        assert!(value.map(|e| e.value).zip(expected).is_none_or(close), "{jitter_secs} s: {value:?}");
    }
}

#[test]
fn poses_that_all_logs_hold_are_no_lost_frames() {
    let (plain, held) = (baseline(0.0, PLAIN), baseline(0.0, HELD));
    assert_eq!(found(Some(&held), 0.0, HELD).chosen, [""; 0]);
    for baseline in [None, Some(&plain)] {
        let found = found(baseline, 0.0, HELD);
        assert!(found.chosen.iter().any(|id| id == "dropped_frames"), "{:?}", found.chosen);
    }
}

#[test]
fn files_of_earlier_versions_know_of_no_quirks() {
    let baseline = baseline(0.005, PLAIN);
    let mut text = serde_json::to_value(&*baseline).expect("JSON");
    let table = text.as_object_mut().expect("a table");
    assert!(table.remove("sampling").is_some() && table.remove("cells").is_some());
    let read: Baseline = serde_json::from_value(text).expect("an old file");
    assert_eq!((read.sampling, read.cells.len()), (Default::default(), 0));
}

#[test]
fn backward_driving_is_left_out_and_said() {
    let root = tempfile::tempdir().expect("a folder");
    let forwards = case(&root.path().join("forwards"), 71, 0.0, PLAIN);
    let case = case(&root.path().join("backwards"), 71, 0.0, BACKWARDS);
    let windows = |case: &Case| case.ego.iter().map(|record| record.anchors.len()).sum::<usize>();
    assert!(windows(&case) < windows(&forwards) && windows(&case) > 0);
    assert!(case.warnings.iter().any(|w| w.contains("of the windows are left out")), "{:?}", case.warnings);
    assert!(!forwards.warnings.iter().any(|w| w.contains("left out")), "{:?}", forwards.warnings);
    let found = diagnose(&case, &Options { quick: true, ..Options::default() });
    assert_eq!(found.verdict, Verdict::None, "{:?}", found.chosen);
    let position = found.how_far.iter().find(|s| s.metric == "position_2s").expect("positions");
    assert!(position.after < 4.0 * position.floor, "{position:?}");
}

//! A watch keeps quiet over healthy drives, tells a fault soon after it began, and refuses baselines that say too little.

use std::path::Path;
use std::sync::{Arc, LazyLock};

use ds_diagnosis::CaseError;
use ds_dynamics::baseline::Baseline;
use ds_dynamics::case::Case;
use ds_dynamics::healthy::{Healthy, learn};
use ds_dynamics::watch::Watch;
use ds_dynamics::{Options, synthetic};

fn case(folder: &Path, seed: u64, fault: Option<(&str, f64)>) -> Case {
    let edit = |plant: &mut ds_effect::Plant| {
        if let Some((id, value)) = fault {
            (ds_effect::find(id).expect("the effect is in the library").apply)(&[value], plant);
        }
    };
    synthetic::write_case(folder, seed, &edit).expect("the case can be written");
    Case::read(folder).expect("the case can be read")
}

/// What three healthy logs say.
static BASELINE: LazyLock<Arc<Baseline>> = LazyLock::new(|| {
    let root = tempfile::tempdir().expect("a folder");
    let one = |seed: u64| {
        let name = format!("day-{seed}");
        Healthy { case: case(&root.path().join(&name), seed, None), name }
    };
    Arc::new(learn(&[61, 62, 63].map(one), &|| ()).expect("three healthy logs"))
});

/// Drives 2 and 3 of a faulty log after drives 0 and 1 of a healthy one.
fn breaks(root: &Path, fault: (&str, f64)) -> Case {
    let (healthy, faulty) = (case(&root.join("a"), 71, None), case(&root.join("b"), 72, Some(fault)));
    let drives = healthy.drives[..2].iter().chain(&faulty.drives[2..]).cloned().collect();
    Case::new(healthy.meta, drives).expect("a case")
}

#[test]
fn healthy_drives_raise_no_alarm_and_a_fault_is_told_and_named() {
    let root = tempfile::tempdir().expect("a folder");
    let baseline = BASELINE.clone();
    let windows = baseline.windows.as_ref().expect("windows of three logs");
    assert_eq!(windows.logs.len(), 3);
    assert!(
        windows.logs.iter().all(|log| log.len() > 50),
        "{:?}",
        windows.logs.iter().map(Vec::len).collect::<Vec<_>>()
    );
    let mut watch = Watch::new(baseline.clone(), 1.0).expect("windows of three logs");
    for seed in 81..84 {
        let healthy = case(&root.path().join("h"), seed, None);
        assert_eq!(watch.log("healthy", &healthy).expect("the same vehicle"), []);
    }
    assert!((0.09..0.12).contains(&watch.hours()), "{}", watch.hours());

    let mut watch = Watch::new(baseline, 1.0).expect("windows of three logs");
    let broken = breaks(root.path(), ("gyro_bias", 0.01));
    let found = watch.log("broken", &broken).expect("the same vehicle");
    let first = found.first().expect("an alarm");
    assert_eq!((first.drive, first.channels[0].0.as_str()), (2, "yaw_rate"), "{first:?}");
    assert!(first.secs < 30.0 && first.since_secs < 8.0, "{first:?}");
    let (diagnosis, from) =
        watch.diagnose(&broken, first, &Options { quick: true, ..Options::default() }).expect("long enough");
    assert_eq!((diagnosis.chosen, from), (vec!["gyro_bias".to_owned()], first.since_secs));
}

#[test]
fn a_baseline_without_windows_is_told_what_it_lacks() {
    let root = tempfile::tempdir().expect("a folder");
    let text = serde_json::to_string(&Baseline { windows: None, ..(**BASELINE).clone() }).expect("JSON");
    assert!(!text.contains("\"windows\""), "a file of an earlier version has no such key");
    let file = root.path().join("old.json");
    std::fs::write(&file, text).expect("it can be written");
    let old = Arc::new(Baseline::read(&file).expect("a diagnosis takes it as before"));
    let refused = Watch::new(old, 1.0).err().expect("it has no windows");
    assert!(matches!(refused, CaseError::Unwatched { logs: 0, least: 3 }), "{refused}");
}

//! Effects injected into a synthetic pair of streams, with offsets, noise and encoder of every case, are found and
//! measured; nothing is found where nothing was injected; a frozen diagnosis helps on frames it never saw.

use ds_diagnosis::{Diagnosis, Verdict};
use ds_frames::{FrameCase, Options, diagnose, evaluate};

fn diagnosed(seed: u64, injected: &[(&str, &[f64])]) -> (Diagnosis, tempfile::TempDir) {
    let folder = tempfile::tempdir().expect("a folder");
    crate::pair::write(folder.path(), seed, injected);
    let found = diagnose(&FrameCase::read(folder.path()).expect("a case"), &Options::default())
        .expect("the case can be diagnosed");
    (found, folder)
}

#[test]
fn a_turned_camera_is_found_measured_and_corrected() {
    let (found, folder) = diagnosed(3, &[("mount_pitch", &[0.7])]);
    assert_eq!((found.verdict, found.chosen.as_slice()), (Verdict::Single, &["mount_pitch".to_owned()][..]));
    assert!((found.effects[0].value - 0.7).abs() < 0.05, "{} instead of 0.7", found.effects[0].value);
    let sum: f64 = found.effects.iter().map(|e| e.probability).sum::<f64>() + found.p_none + found.p_unknown;
    assert!((sum - 1.0).abs() < 1e-9, "{sum}");
    let unseen = evaluate(&found, &FrameCase::read(folder.path()).expect("a case"), Some(9..=11))
        .expect("the frames can be evaluated");
    let image = unseen.iter().find(|s| s.metric == "image_rmse").expect("the image metric");
    assert!(image.data == "unseen" && image.after < 0.6 * image.before, "{image:?}");
}

#[test]
fn a_tone_curve_is_found_and_measured() {
    let (found, _) = diagnosed(5, &[("gamma", &[1.25])]);
    assert_eq!(found.chosen, ["gamma"], "{:?}", found.verdict);
    assert!((found.effects[0].value - 1.25).abs() < 0.05, "{} instead of 1.25", found.effects[0].value);
}

#[test]
fn nothing_is_found_where_nothing_is_missing() {
    let (found, _) = diagnosed(7, &[]);
    assert_eq!(found.verdict, Verdict::None, "{:?}", found.chosen);
    assert!(found.cells.is_empty());
}

#[test]
fn things_that_appear_are_told_from_everything_else() {
    let (found, _) = diagnosed(9, &[("object_hallucination", &[1.5])]);
    assert_eq!(found.effects[0].id, "object_hallucination", "{:?} {:?}", found.verdict, found.chosen);
}

#[test]
fn fine_detail_is_seen_beside_a_turned_camera() {
    let (found, _) = diagnosed(11, &[("mount_yaw", &[0.6]), ("sensor_noise", &[5.0, 0.0])]);
    for id in ["mount_yaw", "sensor_noise"] {
        assert!(found.chosen.iter().any(|c| c == id), "{id} is not among {:?}", found.chosen);
    }
}

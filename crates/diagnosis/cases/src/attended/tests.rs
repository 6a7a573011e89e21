//! Policies look at pairs whose effects are known.

use std::path::Path;

use ds_diagnosis::attended::Attended;
use ds_diagnosis::schema::Shrink;

use super::*;
use crate::case::{Case, Options, Unseen, diagnose, evaluate};

#[path = "../../../frames/tests/pair.rs"]
mod pair;

const WEIGHTS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../configs/models/camera_policy.safetensors");

fn panel(policies: &[&str]) -> Panel {
    let policies = policies.iter().map(|name| (*name).to_owned()).collect();
    Panel { policies, weights: WEIGHTS.into(), effect_free: None }
}

fn told(folder: &Path, policies: &[&str]) -> Result<Diagnosis, CasesError> {
    diagnose(&Case::read(folder)?, &Options { panel: panel(policies), ..Options::default() })
}

fn of_policy<'a>(diagnosis: &'a Diagnosis, policy: &str) -> (&'a Shrink, &'a Attended) {
    let metric = format!("{METRIC}{policy}");
    let shrink = diagnosis.how_far.iter().find(|shrink| shrink.metric == metric);
    let seen = diagnosis.attended.iter().find(|seen| seen.policy == policy);
    (shrink.expect("its metric is measured"), seen.expect("what it attends to is told"))
}

#[test]
fn a_correction_brings_frames_nearer_for_a_policy_and_says_where() {
    let root = tempfile::tempdir().expect("a folder");
    pair::write(root.path(), 5, &[("gamma", &[1.25])]);
    let found = told(root.path(), &["camera", "ltf"]).expect("the case is sound");
    assert_eq!(found.chosen, ["gamma"]);
    for policy in ["camera", "ltf"] {
        let (shrink, seen) = of_policy(&found, policy);
        assert!(shrink.after < 0.5 * shrink.before, "{policy}: {shrink:?}");
        assert_eq!(seen.scenes.len(), 1, "a pair is one scene");
        assert!((seen.scenes[0].before - shrink.before).abs() < 1e-12);
        let [before, after]: [f64; 2] = [|place: &Difference| place.before, |place: &Difference| place.after]
            .map(|of| seen.places.iter().map(of).sum());
        assert!(after < before, "{policy}: nearer in the picture as well, {after} of {before}");
    }
    let unseen = Unseen { panel: panel(&["camera"]), ..Unseen::default() };
    let again = evaluate(&found, &Case::read(root.path()).expect("the case is sound"), unseen).expect("measured");
    let shrink = again.iter().find(|shrink| shrink.metric == "policy_distance.camera").expect("its metric");
    assert!(shrink.data == "unseen" && shrink.after < shrink.before, "{shrink:?}");
}

#[test]
fn without_effect_policies_see_what_the_twin_shows() {
    let root = tempfile::tempdir().expect("a folder");
    pair::write(root.path(), 4, &[]);
    let found = told(root.path(), &["camera"]).expect("the case is sound");
    let (shrink, _) = of_policy(&found, "camera");
    assert!(found.chosen.is_empty());
    assert!(shrink.before < 0.2 && shrink.share_explained.is_none_or(|share| share.abs() < 1e-9), "{shrink:?}");
    assert!(told(root.path(), &[]).expect("the case is sound").attended.is_empty());
}

#[test]
fn who_cannot_look_is_refused_by_name() {
    let root = tempfile::tempdir().expect("a folder");
    pair::write(root.path(), 5, &[]);
    for (policy, says) in
        [("constant-velocity", "tells of nothing"), ("nobody", "nobody"), ("absent.toml", "absent.toml")]
    {
        let error = told(root.path(), &[policy]).expect_err("it cannot look");
        let words = std::iter::successors(Some(&error as &dyn std::error::Error), |error| error.source());
        let words: Vec<String> = words.map(ToString::to_string).collect();
        assert!(words.join(": ").contains(says), "{policy}: {words:?}");
        assert!(panel(&[policy]).digest().is_err(), "{policy}");
    }
    let elsewhere = Panel { weights: root.path().join("camera_policy.safetensors"), ..panel(&["camera"]) };
    let error = elsewhere.digest().expect_err("there are no weights").to_string();
    assert!(error.contains("train policy --kind camera"), "{error}");
}

//! The gap diagnosis from the command line: a labelled case is named, a broken one is refused and spoils no other.

#[path = "harness.rs"]
mod harness;
use harness::{dreamstream, shared};
use serde_json::Value;

#[test]
fn a_labelled_case_is_named_and_a_broken_one_spoils_no_other() {
    let Some(practice) = shared("data/gap-practice") else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let broken = folder.path().join("broken");
    std::fs::create_dir(&broken).expect("a folder");
    std::fs::write(broken.join("meta.json"), "{}").expect("is written");
    let out = folder.path().join("out");
    let case = practice.join("case_03");
    let paths = [&broken, &case, &out].map(|path| path.display().to_string());
    let diagnosed = dreamstream(&["gap", "diagnose", &paths[0], &paths[1], "--quick", "--out", &paths[2]]).output();
    let diagnosed = diagnosed.expect("the binary runs");
    let error = String::from_utf8_lossy(&diagnosed.stderr).into_owned();
    assert_eq!(diagnosed.status.code(), Some(1), "{error}");
    assert!(error.contains("broken") && error.contains("1 of 2 cases"), "{error}");
    let path = out.join("case_03/diagnosis.json");
    let text = std::fs::read_to_string(&path).expect("a diagnosis");
    let diagnosis: Value = serde_json::from_str(&text).expect("JSON");
    let labels = std::fs::read_to_string(practice.join("labels.json")).expect("labels");
    let labels: Value = serde_json::from_str(&labels).expect("JSON");
    assert_eq!(diagnosis["verdict"], "single");
    assert_eq!(diagnosis["effects"][0]["id"], labels["case_03"]["effects"][0]["id"]);
    let diagnosis = path.display().to_string();
    let arguments = ["gap", "evaluate", &diagnosis, &paths[1], "--drives", "3"];
    let evaluated = dreamstream(&arguments).output().expect("the binary runs");
    let shrinks: Value = serde_json::from_slice(&evaluated.stdout).expect("shrinks are JSON");
    let position = shrinks.as_array().and_then(|all| all.iter().find(|one| one["metric"] == "position_2s"));
    let share = position.and_then(|one| one["share_explained"].as_f64()).expect("a share");
    assert!(share > 0.5, "{shrinks}");
}

#[test]
fn folders_without_cases_are_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let arguments = ["gap", "diagnose", &folder.path().display().to_string()];
    let refused = dreamstream(&arguments).output().expect("the binary runs");
    assert!(String::from_utf8_lossy(&refused.stderr).contains("meta.json"), "{refused:?}");
}

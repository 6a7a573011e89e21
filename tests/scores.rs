//! Scores across process borders: what the orchestrator scores live is what a re-score of the recording gives, to the bit;
//! case files are answered by the command line; the oracle changes what is driven and says how good proposals were.

use crate::harness::{Drive, dreamstream, drive, shared, workspace};
use serde_json::Value;

const SCENARIOS: [&str; 2] =
    ["scenarios/base/cut-in.scenario.json", "scenarios/base/signalised-crossing.scenario.json"];

fn rescored(drive: &Drive, index: usize, profile: Option<&str>) -> Value {
    let out = drive.folder.path().join(format!("score-{index}.json"));
    let (recording, out) = (drive.recording(index).display().to_string(), out.display().to_string());
    let mut arguments = vec!["score", &recording, "-o", &out];
    profile.iter().for_each(|name| arguments.extend(["--profile", name]));
    let output = dreamstream(&arguments).output().expect("the binary runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = std::fs::read_to_string(&out).expect("scores");
    let scores: Value = serde_json::from_str(&text).expect("scores are JSON");
    scores[0].clone()
}

#[test]
fn a_rescored_recording_equals_the_live_score() {
    for profile in ["bridgesim", "strict"] {
        let driven = drive(&[
            SCENARIOS[0],
            SCENARIOS[1],
            "--observation",
            "layout",
            "--policy",
            "constant-velocity",
            "--profile",
            profile,
            "--warm-up",
            "1",
        ]);
        for index in 0..SCENARIOS.len() {
            let (live, again) = (driven.episode(index), rescored(&driven, index, None));
            assert!(live["driving_score"].is_f64(), "{live}");
            let keys = ["driving_score", "mean_score", "route_completion", "lost", "first_violations", "score_version"];
            for key in keys.into_iter().chain(["score_profile", "sub_scores"]) {
                assert_eq!(live[key], again[key], "{profile} {key}");
            }
            let other = if profile == "strict" { "bridgesim" } else { "strict" };
            assert_eq!(rescored(&driven, index, Some(other))["score_profile"], other);
        }
    }
}

#[test]
fn the_score_topic_ends_with_the_score_of_the_drive() {
    let driven = drive(&[SCENARIOS[0], "--observation", "layout", "--policy", "constant-velocity"]);
    let lost: f64 = driven.episode(0)["lost"].as_object().expect("a table").values().filter_map(Value::as_f64).sum();
    let mean = driven.episode(0)["mean_score"].as_f64().expect("a mean");
    assert!((lost - (1.0 - mean)).abs() < 1e-9, "{lost} of {mean}");
    let (score, route) = (&driven.episode(0)["driving_score"], &driven.episode(0)["route_completion"]);
    let product = mean * route.as_f64().expect("a share");
    assert!((score.as_f64().expect("a score") - product).abs() < 1e-12);
}

#[test]
fn the_oracle_picks_among_the_proposals_and_says_how_good_they_were() {
    let arguments = [SCENARIOS[0], "--observation", "layout", "--policy", "lattice"];
    let learned = drive(&arguments);
    assert_eq!(learned.episode(0)["scorer"], "learned");
    assert!(learned.episode(0)["proposals"].is_null());
    for (oracle, name) in [("reacting", "oracle"), ("navsim", "oracle-navsim")] {
        let ranked = drive(&[&arguments[..], &["--scorer", "oracle", "--oracle", oracle]].concat());
        let episode = ranked.episode(0);
        assert_eq!((&episode["status"], &episode["scorer"]), (&"completed".into(), &name.into()));
        assert!(episode["proposals"]["ticks"].as_u64().is_some_and(|ticks| ticks >= 10), "{episode}");
        assert!(episode["proposals"]["best_mean"].as_f64().is_some_and(|best| best > 0.0 && best <= 1.0), "{episode}");
        assert_ne!(episode["world_digest"], learned.episode(0)["world_digest"]);
        let again = drive(&[&arguments[..], &["--scorer", "oracle", "--oracle", oracle, "--processes"]].concat());
        assert_eq!(again.digests(0), ranked.digests(0), "{name}");
        assert_eq!(rescored(&ranked, 0, None)["driving_score"], episode["driving_score"]);
    }
}

#[test]
fn case_files_are_answered() {
    let Some(cases) = shared("golden/navsim") else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("out.json").display().to_string();
    let output = dreamstream(&["score", "--cases", &cases.display().to_string(), "-o", &out]).output().expect("runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let answers: Value = serde_json::from_str(&std::fs::read_to_string(&out).expect("answers")).expect("JSON");
    let index = std::fs::read_to_string(cases.join("index.json")).expect("an index");
    let index: Value = serde_json::from_str(&index).expect("JSON");
    let listed = index.as_array().or(index["cases"].as_array()).expect("a list of cases");
    assert!(!listed.is_empty());
    for case in listed {
        let id = case["case_id"].as_str().expect("an id");
        assert!(answers[id].is_object() && answers[id]["error"].is_null(), "{id} has no answer");
    }
}

#[test]
fn bad_cases_are_named_and_spoil_no_other() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join("broken.json"), "{").expect("is written");
    std::fs::write(folder.path().join("odd.json"), r#"{"case_id": "odd", "schema": "none/9"}"#).expect("is written");
    let output = dreamstream(&["score", "--cases", &folder.path().display().to_string()]).output().expect("runs");
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success() && text.contains("broken") && text.contains("odd"), "{text}");
    let none = dreamstream(&["score"]).current_dir(workspace()).output().expect("runs");
    assert!(String::from_utf8_lossy(&none.stderr).contains("recordings"));
}

#[test]
fn folders_of_recorded_drives_are_compared_as_policies_see_their_frames() {
    let runs = ["reference", "reference", "sim-rgb"].map(|source| {
        let driver = ["--observation", source, "--policy", "route-follower"];
        drive(&[&SCENARIOS[..], &driver].concat())
    });
    let [real, same, plain] = &runs;
    let folders = [real, same, plain].map(|run| run.folder.path().to_str().expect("a plain path").to_owned());
    let out = tempfile::tempdir().expect("a temporary folder");
    let json = out.path().join("drives.json");
    let arguments = ["study", "drives", "--real", &folders[0], "--source", &folders[1], "--source", &folders[2]];
    let output = dreamstream(&arguments).arg("--out").arg(out.path()).output().expect("the binary runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let found: Value = serde_json::from_slice(&std::fs::read(json).expect("a file")).expect("JSON");
    // Who drives by the truth goes the same way whatever the frames show: they are of the same states.
    let [equal, other] =
        [1, 2].map(|at: usize| [&found["fd_pi"][&folders[at]]["value"], &found["apart_m"][&folders[at]]]);
    assert!(equal.iter().all(|value| value.as_f64().is_some_and(|value| value.abs() < 1e-6)), "{equal:?}");
    assert!(other[0].as_f64() > Some(0.1) && other[1].as_f64() == Some(0.0), "{other:?}");
    let alone = ["study", "drives", "--real", &folders[0], "--source", out.path().to_str().expect("a plain path")];
    let refused = dreamstream(&alone).output().expect("the binary runs");
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && said.contains("share 0 drives"), "{said}");
    // One folder that holds each drive twice, and one that holds none.
    let twice = tempfile::tempdir().expect("a temporary folder");
    for (index, copy) in [(0, "a.mcap"), (0, "b.mcap"), (1, "c.mcap"), (1, "d.mcap")] {
        std::fs::copy(real.recording(index), twice.path().join(copy)).expect("is copied");
    }
    let doubled = ["study", "drives", "--real", twice.path().to_str().expect("a plain path"), "--source", alone[5]];
    let refused = dreamstream(&doubled).output().expect("the binary runs");
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && said.contains("mcap are of the same scenario and seed"), "{said}");
}

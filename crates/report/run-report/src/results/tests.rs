//! Results files that load, and those that must not.
//!
//! Each refusal has to name the file, the field and the value, in a line of bounded length.

use super::*;
use crate::sample::{drive, ended, run};
use std::path::Path;

/// A file as the first version wrote it, without any of the later fields.
const FIRST_VERSION: &str = r#"{
  "run": {"id": "run-1", "version": "0.1.0", "schema_version": 1, "seeds": [0], "replan_period": 5,
    "horizon_secs": 4.0, "history": 1, "agents": "LogReplay", "tracker": "lqr", "appearance": "dusk",
    "mode": "embedded", "configuration_digest": "", "video_model_digest": "", "policy_model_digest": "",
    "compute_classes": {"sim": "x"}, "insecure": false, "wall_s": 3.5},
  "episodes": [{"scenario": "cut-in", "policy": "log-replay", "observation": "dreamstream", "seed": 0, "attempts": 1,
    "status": "completed", "reason": "", "ticks": 80, "driving_score": null, "driving_score_reason": "not computed",
    "route_completion": 0.9, "sub_scores": {"collision": 1.0, "progress": null}, "frames_per_second": 22.0,
    "wall_s": 3.4, "time_share": {"sim": 0.1, "layout": 0.1, "video": 0.5, "policy": 0.1, "bus": 0.1, "other": 0.1},
    "world_digest": "", "layout_digest": "", "frame_digest": "", "recording": "a.mcap"}]
}"#;

fn parse(text: &str) -> Result<Results, ResultsError> {
    Results::parse(text.as_bytes(), Path::new("runs/results.json"))
}

#[test]
fn files_of_the_first_version_load() {
    let results = parse(FIRST_VERSION).expect("a sound file");
    let episode = &results.episodes[0];
    assert_eq!(episode.appearance, "dusk", "an episode without an appearance takes the run's");
    assert_eq!((episode.set.as_str(), episode.mean_score, &episode.proposals), ("", None, &None));
    assert!(episode.lost.is_empty() && episode.first_violations.is_empty() && episode.profile().is_empty());
}

#[test]
fn what_is_saved_loads() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("results.json");
    let mut results = run("r", crate::sample::runs()[0].episodes.clone());
    results.episodes.push(Episode { appearance: "day".into(), ..ended("x", "y", u64::MAX, "running") });
    results.save(&path).expect("sound results");
    assert_eq!(Results::load(&path).expect("what was saved"), results);
    let names: Vec<_> = std::fs::read_dir(folder.path()).expect("the folder").collect();
    assert_eq!(names.len(), 1, "nothing but the file is left");
}

#[test]
fn what_cannot_be_read_is_not_saved() {
    let path = Path::new("results.json");
    for value in [f64::NAN, f64::INFINITY, -0.1, 1.5] {
        let results = run("r", vec![drive("a", "p", 0, value)]);
        assert!(matches!(results.save(path), Err(ResultsError::Value { .. })), "{value} was saved");
    }
}

#[test]
fn hostile_files_are_refused_by_name() {
    let replaced = |from: &str, to: &str| {
        assert!(FIRST_VERSION.contains(from), "{from}");
        FIRST_VERSION.replacen(from, to, 1)
    };
    let episode =
        &FIRST_VERSION[FIRST_VERSION.find("[{").expect("episodes") + 1..FIRST_VERSION.rfind(']').expect("end")];
    let many_terms: Vec<String> = (0..65).map(|i| format!("\"t{i}\": 1.0")).collect();
    let rows: Vec<(&str, String, &str)> = vec![
        ("empty", String::new(), "EOF"),
        ("truncated", FIRST_VERSION[..FIRST_VERSION.len() / 2].to_owned(), "EOF"),
        ("two files in one", format!("{FIRST_VERSION}{FIRST_VERSION}"), "trailing characters"),
        ("not an object", "[]".to_owned(), "invalid length 0"),
        ("NaN", replaced("\"route_completion\": 0.9", "\"route_completion\": NaN"), "episodes[0].route_completion"),
        ("infinite", replaced("0.9", "1e999"), "number out of range"),
        ("negative", replaced("0.9", "-0.25"), "\"episodes[0].route_completion\" is -0.25, not in 0..=1"),
        (
            "over one",
            replaced("\"collision\": 1.0", "\"collision\": 1.01"),
            "\"episodes[0].sub_scores.collision\" is 1.01",
        ),
        (
            "wrong type",
            replaced("\"seed\": 0", "\"seed\": \"zero\""),
            "\"episodes[0].seed\": invalid type: string \"zero\"",
        ),
        ("negative tick", replaced("\"ticks\": 80", "\"ticks\": -1"), "episodes[0].ticks"),
        ("missing field", replaced("\"policy\": \"log-replay\", ", ""), "missing field `policy`"),
        ("unknown status", replaced("\"completed\"", "\"fine\""), "\"episodes[0].status\" is \"fine\""),
        ("no name", replaced("\"cut-in\"", "\"\""), "\"episodes[0].scenario\" is \"\", a name is needed"),
        ("huge name", replaced("cut-in", &"a".repeat(1_000_000)), "\"episodes[0].scenario\" is 1000000 bytes"),
        (
            "huge value",
            replaced("\"ticks\": 80", &format!("\"ticks\": \"{}\"", "9".repeat(1_000_000))),
            "episodes[0].ticks",
        ),
        ("huge number", replaced("\"ticks\": 80", "\"ticks\": 1000000000000"), "episodes[0].ticks"),
        (
            "too many terms",
            replaced("\"collision\": 1.0", &many_terms.join(", ")),
            "of the file's terms, the limit is 64",
        ),
        ("duplicate", FIRST_VERSION.replacen("[{", &format!("[{episode}, {{"), 1), "episodes[1] repeats episodes[0]"),
        ("deep", "[".repeat(100_000), "EOF"),
        (
            "late violation",
            replaced("\"ticks\": 80", "\"ticks\": 80, \"first_violations\": {\"nc\": 81}"),
            "first_violations.nc",
        ),
        (
            "loss",
            replaced("\"ticks\": 80", "\"ticks\": 80, \"lost\": {\"nc\": -0.1}"),
            "\"episodes[0].lost.nc\" is -0.1",
        ),
        (
            "proposals",
            replaced(
                "\"ticks\": 80",
                r#""ticks": 80, "proposals": {"best_mean": 0.5, "ticks_without_positive": 9, "ticks": 8}"#,
            ),
            "\"episodes[0].proposals.ticks_without_positive\" is 9",
        ),
    ];
    for (name, text, expected) in rows {
        let error = parse(&text).expect_err(name).to_string();
        let known = error.contains(expected) || (name == "deep" || name == "not an object");
        assert!(known, "{name}: {error}");
        assert!(error.contains("runs/results.json") && error.len() < 700, "{name}: {error}");
    }
}

#[test]
fn a_duplicate_is_named_by_its_drive() {
    let twice = run("r", vec![drive("a", "p", 3, 0.5), drive("b", "p", 3, 0.5), drive("a", "p", 3, 0.5)]);
    let bytes = serde_json::to_vec(&twice).expect("plain values");
    let error = Results::parse(&bytes, Path::new("r.json")).expect_err("a drive twice").to_string();
    assert!(error.contains("episodes[2] repeats episodes[0]") && error.contains("seed 3"), "{error}");
    let apart = run(
        "r",
        vec![drive("a", "p", 3, 0.5), drive("a", "p", 4, 0.5), Episode { set: "x".into(), ..drive("a", "p", 3, 0.5) }],
    );
    let bytes = serde_json::to_vec(&apart).expect("plain values");
    assert!(Results::parse(&bytes, Path::new("r.json")).is_ok());
}

#[test]
fn large_files_are_not_read() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("results.json");
    let file = std::fs::File::create(&path).expect("a file");
    file.set_len(MAX_FILE_BYTES + 1).expect("a sparse file");
    assert!(matches!(Results::load(&path), Err(ResultsError::TooLarge { .. })));
    assert!(matches!(Results::load(&folder.path().join("none.json")), Err(ResultsError::Read { .. })));
}

#[test]
fn the_screen_counts_what_did_not_finish() {
    let results = run("r", vec![drive("a", "p", 0, 0.5), ended("b", "p", 0, "failed"), ended("c", "p", 0, "aborted")]);
    let table = results.table();
    assert!(
        table.ends_with("3 episodes: 1 completed, 1 failed, 1 aborted") && table.contains("└ plan refused"),
        "{table}"
    );
}

//! The trainer knows the words that `dreamstream` hands over, teaches them, and refuses others with their name.

use std::process::{Command, Output};

use ds_process::run_folder::{self, Earlier};

/// The shipped study, from the folder of this package.
const FIDELITY: &str = "../../configs/study/fidelity.toml";

fn trainer(words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_trainer")).args(words).output().expect("the process runs")
}

#[test]
fn every_command_teaches_its_words() {
    for (command, teaches) in
        [("data", "render"), ("train", "self-forcing"), ("video", "first-frame"), ("study", "closed-loop")]
    {
        let Output { status, stdout, .. } = trainer(&["--log", "warn", command, "--help"]);
        let said = String::from_utf8_lossy(&stdout);
        assert!(
            status.success() && said.contains(teaches) && said.contains(&format!("dreamstream {command}")),
            "{said}"
        );
    }
}

#[test]
fn what_is_not_meant_is_refused_by_name() {
    for (words, code, says) in [
        (&["train", "sleep"][..], 64, "sleep"),
        (&["data", "render"], 64, "--config"),
        (&["study", "fidelity", "--config", "none.toml"], 64, "none.toml"),
        (&["study", "drives"], 64, "--real"),
        (&["study", "drives", "--real", "a", "--source", "b", "--recorded", "none.toml"], 64, "--recorded"),
        (&["study", "drives", "--config", FIDELITY, "--recorded", "none.toml"], 64, "none.toml"),
        (&["video", "eval", "--config", "none.toml"], 1, "none.toml"),
    ] {
        let Output { status, stderr, .. } = trainer(words);
        let said = String::from_utf8_lossy(&stderr);
        assert_eq!((status.code(), said.contains(says)), (Some(code), true), "{words:?}: {said}");
    }
}

#[test]
fn a_network_for_fid_is_refused_by_name() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().to_str().expect("a plain path");
    let words = ["study", "fidelity", "--quick", "--config", FIDELITY, "--fid", "inception.toml", "--out", out];
    let Output { status, stderr, .. } = trainer(&words);
    let said = String::from_utf8_lossy(&stderr);
    assert!(status.code() == Some(64) && said.contains("fid: ") && said.contains("inception.toml"), "{said}");
    let Output { status, stderr, .. } = trainer(&["study", "closed-loop", "--fvd", "clips.toml", "--out", out]);
    let said = String::from_utf8_lossy(&stderr);
    assert!(!status.success() && said.contains("--fvd"), "{said}");
}

#[test]
fn a_folder_holds_one_study_at_a_time() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().to_str().expect("a plain path");
    let held = run_folder::take(folder.path(), Earlier::Resumed).expect("a fresh folder");
    let configs = ["fidelity", "closed-loop"].map(|name| format!("../../configs/study/{name}.toml"));
    for words in [
        &["study", "fidelity", "--config", &configs[0], "--out", out][..],
        &["study", "closed-loop", "--config", &configs[1], "--out", out],
        &["study", "drives", "--config", &configs[0], "--real", "none", "--source", "none", "--out", out],
    ] {
        let Output { status, stderr, .. } = trainer(words);
        let said = String::from_utf8_lossy(&stderr);
        let says = said.contains(out) && said.contains("in use by another run") && said.contains("--out");
        assert_eq!((status.code(), says), (Some(1), true), "{words:?}: {said}");
    }
    assert_eq!(std::fs::read_dir(folder.path()).expect("the folder").count(), 1, "nothing but the lock");
    drop(held);
    let said =
        trainer(&["study", "drives", "--config", &configs[0], "--real", "none", "--source", "none", "--out", out]);
    assert!(String::from_utf8_lossy(&said.stderr).contains("folder none"), "given back: {said:?}");
    // What another study found there stays.
    std::fs::write(folder.path().join("correlation.json"), "{}").expect("writes");
    for (study, config) in ["fidelity", "closed-loop"].iter().zip(&configs) {
        let Output { status, stderr, .. } = trainer(&["study", study, "--config", config, "--out", out]);
        let said = String::from_utf8_lossy(&stderr);
        assert_eq!((status.code(), said.contains("is of study correlation")), (Some(64), true), "{said}");
    }
}

#[test]
fn studies_of_nothing_are_refused_by_name() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("study.toml");
    let sound = "version = 1\nout = \"out\"\nsets = [\"a.set.json\"]\npolicies = [\"mine.toml\"]\nseeds = [1]\ndraws = 10\nmodel = \"m\"\n\
        policy_weights = \"w\"\nsources = [\"layout\", \"sim-rgb\"]\nnearer = [[\"layout\", \"sim-rgb\"]]\n";
    for (from, to, says) in [
        ("[\"mine.toml\"]", "[]", "policies must name one"),
        ("seeds = [1]", "seeds = []", "seeds must name one"),
        ("[\"a.set.json\"]", "[]", "sets must name one"),
        ("[\"layout\", \"sim-rgb\"]\nnearer", "[\"reference\"]\nnearer", "sources must name one besides the reference"),
        ("[[\"layout\", \"sim-rgb\"]]", "[[\"layout\", \"layout\"]]", "\"layout\" is nearer than itself"),
        ("[[\"layout\", \"sim-rgb\"]]", "[[\"layout\", \"logged\"]]", "\"logged\", which is not among sources"),
        ("draws = 10", "draws = 0", "draws must be 1 to 100000"),
    ] {
        std::fs::write(&path, sound.replace(from, to)).expect("writes");
        let words = ["study", "closed-loop", "--config", path.to_str().expect("a plain path")];
        let Output { status, stderr, .. } = trainer(&words);
        let said = String::from_utf8_lossy(&stderr);
        assert_eq!((status.code(), said.contains(says)), (Some(64), true), "{says}: {said}");
    }
    // A manifest lies beside the configuration that names it.
    let set = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/benchmark/town.set.json");
    std::fs::write(&path, sound.replace("a.set.json", set)).expect("writes");
    let out = folder.path().join("out").display().to_string();
    let words = ["study", "closed-loop", "--config", path.to_str().expect("a plain path"), "--out", &out];
    let Output { status, stderr, .. } = trainer(&words);
    let (said, manifest) = (String::from_utf8_lossy(&stderr), folder.path().join("mine.toml"));
    assert_eq!((status.code(), said.contains(&manifest.display().to_string())), (Some(64), true), "{said}");
}

#[test]
fn a_reader_who_leaves_changes_no_exit_code() {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let mut plan = Command::new(env!("CARGO_BIN_EXE_trainer"));
    plan.args(["train", "plan", "--config", "../../configs/train/cpu_train.toml"])
        .stdout(writer.try_clone().expect("a second end"))
        .stderr(writer);
    assert!(plan.status().expect("the process runs").success());
}

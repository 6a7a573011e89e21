//! The trainer knows the words that `dreamstream` hands over, teaches them, and refuses others with their name.

use std::process::{Command, Output};

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
        (&["study", "fidelity", "--config", "none.toml"], 1, "none.toml"),
        (&["video", "eval", "--config", "none.toml"], 1, "none.toml"),
    ] {
        let Output { status, stderr, .. } = trainer(words);
        let said = String::from_utf8_lossy(&stderr);
        assert_eq!((status.code(), said.contains(says)), (Some(code), true), "{words:?}: {said}");
    }
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

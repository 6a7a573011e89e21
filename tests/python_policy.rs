//! A policy of ten lines in Python drives over the policy bus from another process; bad ones end their drive by name.

#[path = "harness.rs"]
mod harness;
use std::process::{Child, Command, Stdio};

use harness::{command, finished, free_port, python, text, workspace};

const SCENARIO: &str = "scenarios/base/free-curve.scenario.json";

struct Guest(Child);

impl Drop for Guest {
    fn drop(&mut self) {
        let _already_gone = self.0.kill();
        let _reaped = self.0.wait();
    }
}

/// Drives with a Python class; returns the episode.
fn drive_with(source: &str, class: &str) -> Option<serde_json::Value> {
    let python = python()?;
    let folder = tempfile::tempdir().expect("a temporary folder");
    let script = folder.path().join("mine.py");
    std::fs::write(&script, source).expect("a script");
    let endpoint = format!("tcp/127.0.0.1:{}", free_port());
    let mut guest = Command::new(python);
    guest.args(["-m", "dreamstream", "run"]).arg(format!("{}:{class}", script.display()));
    guest.args(["--name", "mine", "--connect", &endpoint]).current_dir(workspace());
    guest.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::inherit());
    let out = folder.path().join("out");
    std::fs::create_dir(&out).expect("a folder");
    let mut drive = command(
        &[SCENARIO, "--policy", "mine", "--policy-listen", &endpoint, "--observation", "layout", "--duration", "2"],
        &out,
    );
    let child = drive.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the binary starts");
    let _guest = Guest(guest.spawn().expect("python starts"));
    let output = child.wait_with_output().expect("the drive ends");
    let results = std::fs::read_to_string(out.join("results.json"))
        .unwrap_or_else(|error| panic!("no results ({error}): {}", String::from_utf8_lossy(&output.stderr)));
    let results: serde_json::Value = serde_json::from_str(&results).expect("results are JSON");
    Some(results["episodes"][0].clone())
}

#[test]
fn ten_lines_drive_an_episode() {
    let source =
        std::fs::read_to_string(workspace().join("clients/python/examples/constant_velocity.py")).expect("the example");
    let Some(episode) = drive_with(&source, "ConstantVelocity") else { return };
    assert_eq!(episode["status"], "completed", "{episode}");
    assert_eq!(episode["ticks"], 20);
}

#[test]
fn bad_answers_end_the_drive_with_a_named_reason() {
    let cases = [
        ("np.full((4, 3), np.nan)", "nan"),
        ("np.zeros((0, 3))", "pose"),
        ("np.zeros((4, 7))", ""),
        ("np.full((4, 3), 1e9)", ""),
    ];
    for (answer, says) in cases {
        let source = format!(
            "import numpy as np\nfrom dreamstream import Policy\n\nclass Bad(Policy):\n    def plan(self, observation):\n        return {answer}\n"
        );
        let Some(episode) = drive_with(&source, "Bad") else { return };
        assert_eq!(episode["status"], "failed", "{answer}: {episode}");
        let reason = text(&episode["reason"]).to_lowercase();
        assert!(reason.starts_with("policy") || reason.starts_with("plan"), "{answer}: {reason:?}");
        assert!(reason.contains(says), "{answer}: {reason:?} does not say {says:?}");
    }
}

#[test]
fn an_independent_reader_opens_the_recording() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = command(
        &[SCENARIO, "--observation", "layout", "--policy", "constant-velocity", "--duration", "2"],
        folder.path(),
    )
    .output()
    .expect("runs");
    let drive = finished(folder, output);
    let script = workspace().join("tests/read_recording.py");
    let read = Command::new(python).arg(script).arg(drive.recording(0)).output().expect("python runs");
    let said = String::from_utf8_lossy(&read.stdout).into_owned();
    assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
    let counts: serde_json::Value = serde_json::from_str(&said).expect("counts as JSON");
    assert_eq!(counts["world"], 21, "{counts}");
    assert_eq!(counts["frame"], 21, "{counts}");
    assert_eq!(counts["layout"], 21, "{counts}");
    assert_eq!(counts["plan"], 4, "{counts}");
}

//! A stranger on the policy bus that listens to `**`, asks for `**` and writes to foreign keys learns and changes nothing.

use std::process::{Command, Stdio};

use crate::harness::{command, free_port, python, text, workspace};

const SCENARIO: &str = "scenarios/base/free-curve.scenario.json";

/// Drives with the example policy, with or without a stranger beside it; returns the digests and what he saw.
fn drive(with_stranger: bool) -> Option<(Vec<String>, Option<serde_json::Value>)> {
    let python = python()?;
    let endpoint = format!("tcp/127.0.0.1:{}", free_port());
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut guest = Command::new(&python);
    guest.args(["-m", "dreamstream", "run", "clients/python/examples/constant_velocity.py:ConstantVelocity"]);
    guest.args(["--name", "mine", "--connect", &endpoint]).current_dir(workspace());
    let arguments =
        [SCENARIO, "--policy", "mine", "--policy-listen", &endpoint, "--observation", "layout", "--duration", "4"];
    let drive =
        command(&arguments, folder.path()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().expect("starts");
    let stranger = with_stranger.then(|| {
        let mut stranger = Command::new(&python);
        stranger.arg(workspace().join("tests/outsider.py")).arg(&endpoint);
        let child = stranger.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
        let mut child = child.expect("python starts");
        // The policy starts only when the stranger listens, so that there is nothing that he could have missed.
        let mut said = String::new();
        let errors = child.stderr.take().expect("a pipe");
        std::io::BufRead::read_line(&mut std::io::BufReader::new(errors), &mut said).expect("a line");
        assert!(said.contains("connected"), "{said:?}");
        child
    });
    let mut guest = guest.stdin(Stdio::null()).stdout(Stdio::null()).spawn().expect("python starts");
    let output = drive.wait_with_output().expect("the drive ends");
    let seen = stranger.map(|mut child| {
        drop(child.stdin.take());
        let output = child.wait_with_output().expect("the stranger ends");
        serde_json::from_slice(&output.stdout).expect("what he saw as JSON")
    });
    let _already_gone = guest.kill();
    let _reaped = guest.wait();
    let results = std::fs::read_to_string(folder.path().join("results.json"))
        .unwrap_or_else(|error| panic!("no results ({error}): {}", String::from_utf8_lossy(&output.stderr)));
    let results: serde_json::Value = serde_json::from_str(&results).expect("JSON");
    let episode = &results["episodes"][0];
    assert_eq!(episode["status"], "completed", "{episode}");
    let digests = ["world_digest", "layout_digest", "frame_digest"].map(|key| text(&episode[key]));
    Some((digests.to_vec(), seen))
}

#[test]
fn a_stranger_learns_and_changes_nothing() {
    let Some((alone, _)) = drive(false) else { return };
    let Some((beside, seen)) = drive(true) else { return };
    let seen = seen.expect("there was a stranger");
    assert_eq!(seen["connected"], true);
    assert_eq!(seen["received"].as_array().map(Vec::len), Some(0), "{seen}");
    assert_eq!(alone, beside);
}

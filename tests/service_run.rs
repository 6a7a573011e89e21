//! Python processes in a stage's place on the bus: a whole drive, one killed in the middle, and a sealed run diagnosed from
//! its vehicle logs alone, without effect and with one.

use std::path::{Path, PathBuf};

use crate::harness::{children, command, finished, python, python_with, signal, start, text, wait_for, workspace};
use serde_json::Value;

const SCENARIO: &str = "scenarios/base/free-curve.scenario.json";

/// Returns a Python with all that a stage needs.
fn stage_python() -> Option<PathBuf> {
    python()?;
    python_with("ready-for-stages", &["./clients/python[stage]", "pillow"])
}

/// Returns the flag that puts a Python stage in a role's place.
fn stage(python: &Path, role: &str, script: &str, arguments: &str) -> String {
    format!("{role}={} {} {arguments}", python.display(), workspace().join("tests/worlds").join(script).display())
}

fn flags(stage: &str) -> Vec<&str> {
    let fixed = ["--policy", "log-replay", "--observation", "layout", "--vehicle-log", "--duration", "6", "--stage"];
    fixed.into_iter().chain([stage]).collect()
}

fn digests(results: &Value) -> Vec<String> {
    let keys = ["world_digest", "layout_digest", "frame_digest"];
    keys.map(|key| text(&results["episodes"][0][key])).to_vec()
}

#[test]
fn a_killed_python_simulator_goes_on_from_its_snapshot() {
    let Some(python) = stage_python() else { return };
    let flag = stage(&python, "sim", "world_stage.py", "--seed 5 --effect steer_delay=0.1 --effect cmd_hold_rate=6");
    let arguments: Vec<&str> = [SCENARIO].into_iter().chain(flags(&flag)).collect();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = command(&arguments, folder.path()).output().expect("runs");
    let whole = finished(folder, output);
    assert_eq!(whole.episode(0)["status"], "completed", "{}", String::from_utf8_lossy(&whole.output.stderr));
    assert_eq!(whole.episode(0)["ticks"], 60);

    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut child = start(&arguments, folder.path());
    let script = workspace().join("tests/worlds/world_stage.py");
    let journal = folder.path().join("recordings");
    let under_way = || {
        let written =
            std::fs::read_dir(&journal).ok()?.flatten().any(|f| f.metadata().is_ok_and(|m| m.len() > 200_000));
        written.then_some(())
    };
    wait_for("a part of the journal", 60, under_way);
    let pid = wait_for("the stage", 10, || children(child.id(), &script.display().to_string()).first().copied());
    signal(pid, "KILL");
    assert!(child.wait().expect("the drive ends").success(), "see stderr.txt");
    let results = std::fs::read_to_string(folder.path().join("results.json")).expect("results");
    assert_eq!(digests(&serde_json::from_str(&results).expect("JSON")), digests(&whole.results));
}

#[test]
fn sealed_runs_of_a_python_world_are_diagnosed_from_their_logs() {
    let Some(python) = stage_python() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let runs = workspace().join("tests/worlds/service_runs.py");
    for (number, (arguments, wanted)) in
        [("--kind none", "none"), ("--effect steer_offset=0.014", "single")].into_iter().enumerate()
    {
        let out = folder.path().join(format!("run_{number}"));
        let mut make = std::process::Command::new(&python);
        let ground = workspace().join("tests/worlds/proving_ground.py");
        make.arg(ground).arg("--out").arg(out.join("ground")).args(["--seed", "3", "--count", "3", "--secs", "12"]);
        assert!(make.status().expect("python runs").success(), "{}", runs.display());
        let flag = stage(&python, "sim", "world_stage.py", &format!("--seed 11 {arguments}"));
        let ground = out.join("ground");
        let mut words = vec![ground.to_str().expect("UTF-8")];
        words.extend(["--policy", "log-replay", "--observation", "layout", "--vehicle-log", "--duration", "0"]);
        words.extend(["--stage", &flag]);
        let output = command(&words, &out.join("world")).output().expect("runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let mut diagnose = crate::harness::dreamstream(&["gap", "diagnose", "--quick", "--no-pages"]);
        let output = diagnose.arg(out.join("world/real")).arg("-o").arg(out.join("gap")).output().expect("runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let said = std::fs::read_to_string(out.join("gap/world/diagnosis.json")).expect("a diagnosis");
        let said: Value = serde_json::from_str(&said).expect("JSON");
        assert_eq!(said["verdict"], wanted, "{arguments}: {}", said["effects"][0]);
        if wanted == "single" {
            assert_eq!(said["chosen"][0], "steer_offset", "{}", said["effects"]);
        }
    }
}

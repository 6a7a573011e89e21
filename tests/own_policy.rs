//! A network of others as an ONNX file drives as the same network in a process of its own; bad ones are refused by name.

use std::path::PathBuf;
use std::process::{Command, Stdio};

use crate::harness::{Drive, command, finished, free_port, python_with, workspace};

const SCENARIO: &str = "scenarios/base/free-curve.scenario.json";

/// Returns a Python that writes ONNX files, and a folder with the exported network.
fn exported() -> Option<(PathBuf, tempfile::TempDir)> {
    crate::harness::python()?;
    let python = python_with("onnx", &["onnx"])?;
    let folder = tempfile::tempdir().expect("a temporary folder");
    say(Command::new(&python).arg(script()).arg("export").arg(folder.path()));
    Some((python, folder))
}

fn script() -> PathBuf {
    workspace().join("tests/own_policy.py")
}

fn say(command: &mut Command) -> String {
    let output = command.output().expect("python runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn drive(policy: &str, further: &[&str]) -> Drive {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shared = [SCENARIO, "--policy", policy, "--duration", "2", "--observation", "reference"];
    let output = command(&[&shared, further].concat(), folder.path()).output().expect("runs");
    finished(folder, output)
}

#[test]
fn an_onnx_file_drives_as_the_same_network_in_a_process_of_its_own() {
    let Some((python, folder)) = exported() else { return };
    let manifest = folder.path().join("numpy.toml");
    let manifest = manifest.to_str().expect("a plain path");
    let inside = drive(manifest, &[]);
    let endpoint = format!("tcp/127.0.0.1:{}", free_port());
    let class = format!("{}:Twin", script().display());
    let mut guest = Command::new(&python)
        .args(["-m", "dreamstream", "run", &class, "--name", "numpy", "--connect", &endpoint])
        .stdout(Stdio::null())
        .spawn()
        .expect("python starts");
    let outside = drive("numpy", &["--policy-listen", &endpoint]);
    guest.kill().expect("the guest runs");
    guest.wait().expect("the guest ends");
    let said =
        say(Command::new(&python).arg(script()).arg("compare").arg(inside.recording(0)).arg(outside.recording(0)));
    let numbers: Vec<f64> = said.split_whitespace().map(|number| number.parse().expect("a number")).collect();
    assert!(numbers[0] < 1e-4, "plans lie {} apart", numbers[0]);
    assert!(numbers[1] > 1e-3, "plans of different moments differ");
    assert!(numbers[2] < 1e-4, "what both attend to lies {} apart in the recordings", numbers[2]);
    let apart = drive(manifest, &["--processes"]);
    let same = say(Command::new(&python).arg(script()).arg("compare").arg(inside.recording(0)).arg(apart.recording(0)));
    assert!(same.starts_with("0.0 "), "separate processes plan the same to the bit: {same}");
}

#[test]
fn the_doctor_asks_for_batches_and_in_new_processes() {
    let Some((_, folder)) = exported() else { return };
    let manifest = folder.path().join("numpy.toml");
    let doctor = ["policy", "doctor", manifest.to_str().expect("a plain path"), "--json"];
    let output = crate::harness::dreamstream(&doctor).output().expect("runs");
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(told["fixtures"].as_array().map(Vec::len), Some(8), "{told}");
    assert_eq!(told["findings"], serde_json::json!([]), "{told}");
    assert_eq!(told["feature"], serde_json::json!([240, 6]), "{told}");
    let remarks = told["remarks"].as_array().expect("remarks");
    let batch = remarks.iter().find(|remark| remark["check"] == "batch").expect("a remark of batches");
    assert!(crate::harness::text(&batch["says"]).starts_with("answers to 2 and 8 at once"), "{told}");
    assert!(
        remarks.iter().all(|remark| remark["check"] != "determinism"),
        "new processes plan the same to the bit: {told}"
    );
}

#[test]
fn manifests_and_networks_that_do_not_fit_are_refused_before_anything_starts() {
    let Some((_, folder)) = exported() else { return };
    let sound = std::fs::read_to_string(folder.path().join("numpy.toml")).expect("the manifest");
    let refused = |name: &str, text: &str, says: &str| {
        let manifest = folder.path().join(name);
        std::fs::write(&manifest, text).expect("write");
        let policy = manifest.to_str().expect("a plain path");
        let output = command(&[SCENARIO, "--policy", policy], &folder.path().join("out")).output().expect("runs");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(64), "{says}: {said}");
        assert!(said.contains(says), "{said:?} does not say {says:?}");
    };
    refused(
        "a.toml",
        &sound.replace("name = \"numpy\"", "name = \"camera\""),
        "a built-in policy is called \"camera\"",
    );
    refused(
        "b.toml",
        &sound.replace("[160, 96]", "[80, 48]"),
        "has shape [?, 3, 96, 160], the manifest gives [1, 3, 48, 80]",
    );
    refused(
        "c.toml",
        &sound.replace("output = \"plan\"", "output = \"way\""),
        "has no output \"way\", it gives \"plan\"",
    );
    refused("d.toml", &sound.replace("file = \"numpy.onnx\"", "file = \"none.onnx\""), "none.onnx");
    refused("e.toml", &sound.replace("size_px", "history = 3\nsize_px"), "the manifest gives [1, 9, 96, 160]");
    refused("f.toml", &sound.replace("beyond = \"hold\"", "beyond = \"hope\""), "hope");
    let digest = format!("file = \"numpy.onnx\"\ndigest = \"{}\"", "0".repeat(64));
    refused("g.toml", &sound.replace("file = \"numpy.onnx\"", &digest), "the manifest says 000");
}

#[test]
fn who_cannot_be_examined_is_refused_by_name() {
    for (name, says) in [
        ("nosuch", "unknown policy"),
        ("mine.onnx", "named by its manifest, FILE.toml"),
        ("mine.py", "FILE.py:CLASS"),
        ("route-follower", "is privileged"),
        ("nosuch.toml", "nosuch.toml"),
    ] {
        let output = crate::harness::dreamstream(&["policy", "doctor", name]).output().expect("runs");
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!((output.status.code(), said.contains(says)), (Some(64), true), "{name}: {said}");
    }
}

#[test]
fn the_study_looks_at_frames_through_an_onnx_network() {
    let Some((python, folder)) = exported() else { return };
    let config = |member: &str| {
        let path = folder.path().join("study.toml");
        let shared = "version = 1\nout = \"study\"\nfirst_seed = 31_600_000\nscenarios = 6\nframes = 16\nevery = 8\nlook = \"daylight\"\n\
            draws = 20\nclip = 16\nsize_px = [160, 96]\nsources = [\"reference\", \"sim-rgb\"]\nratios = []\n";
        let weights = workspace().join("configs/models/look.safetensors");
        let text = format!("{shared}look_weights = {weights:?}\n[[panel]]\nname = \"twin\"\n{member}");
        std::fs::write(&path, text).expect("write");
        let study = ["study", "fidelity", "--config", path.to_str().expect("a plain path")];
        crate::harness::dreamstream(&study).current_dir(folder.path()).output().expect("runs")
    };
    let done = config("policy = \"numpy.toml\"\n");
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let said = String::from_utf8_lossy(&done.stdout).into_owned();
    assert!(said.contains("twin"), "{said}");
    // The same network as a guest: what it tells over the bus is at the same distance.
    let endpoint = format!("tcp/127.0.0.1:{}", free_port());
    let class = format!("{}:Twin", script().display());
    let guest = ["-m", "dreamstream", "run", &class, "--name", "numpy", "--connect", &endpoint];
    let mut guest = Command::new(&python).args(guest).stdout(Stdio::null()).spawn().expect("python starts");
    let connected = config(&format!("policy = \"numpy\"\nlisten = {endpoint:?}\n"));
    guest.kill().expect("the guest runs");
    guest.wait().expect("the guest ends");
    assert!(connected.status.success(), "{}", String::from_utf8_lossy(&connected.stderr));
    let distance = |said: &str| -> f64 {
        let line = said.lines().find_map(|line| line.strip_prefix("FDpi sim-rgb: ")).expect("a distance");
        line.split(' ').next().and_then(|value| value.parse().ok()).expect("a number")
    };
    let outside = String::from_utf8_lossy(&connected.stdout).into_owned();
    let (one, other) = (distance(&said), distance(&outside));
    assert!(one > 1.0 && (one - other).abs() < 1e-3 * one, "{said}\n{outside}");
    let refused = config("policy = \"numpy.toml\"\nweights = \"numpy.onnx\"\n");
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(refused.status.code() == Some(64) && said.contains("a manifest names its network"), "{said}");
}

//! Whole drives by the real binary: shipped scenarios, real logs, embedded and as processes, recordings and views.

use crate::harness::{dreamstream, drive, shared, text, workspace};

const TINY: &str = "scenarios/base/free-curve.scenario.json";

fn check_episode(episode: &serde_json::Value, ticks: u64) {
    assert_eq!(episode["status"], "completed", "{episode}");
    assert_eq!(episode["ticks"], ticks);
    for key in ["world_digest", "layout_digest", "frame_digest"] {
        assert_eq!(text(&episode[key]).len(), 64, "{key} of {episode}");
    }
    for key in ["collision", "no_at_fault_collision", "drivable_area", "time_to_collision", "progress"] {
        let value = &episode["sub_scores"][key];
        assert!(value.is_null() || value.as_f64().is_some_and(|v| (0.0..=1.0).contains(&v)), "{key} is {value}");
    }
    match episode["driving_score"].as_f64() {
        Some(score) => assert!((0.0..=1.0).contains(&score), "{episode}"),
        None => assert!(!text(&episode["driving_score_reason"]).is_empty(), "{episode}"),
    }
    let shares: f64 = episode["time_share"].as_object().expect("an object").values().filter_map(|v| v.as_f64()).sum();
    assert!((shares - 1.0).abs() < 1e-9, "time shares sum to {shares}");
}

#[test]
fn every_observation_source_drives_on_frames_of_its_own() {
    let sources = ["layout", "sim-rgb", "reference", "dreamstream", "logged", "reprojected", "second-camera"];
    let ablated = ["per-frame", "dreamstream-clean-cache", "dreamstream-no-layout"];
    let (mut frames, mut models) = (std::collections::BTreeSet::new(), std::collections::BTreeSet::new());
    for observation in sources.into_iter().chain(ablated) {
        let drive = drive(&[TINY, "--observation", observation, "--policy", "constant-velocity", "--duration", "1"]);
        check_episode(drive.episode(0), 10);
        assert_eq!(drive.episode(0)["observation"], observation);
        assert!(drive.recording(0).exists());
        assert!(
            frames.insert(text(&drive.episode(0)["frame_digest"]).to_owned()),
            "{observation} has frames of another"
        );
        let model = text(&drive.results["run"]["video_model_digest"]).to_owned();
        let generated = observation == "dreamstream" || ablated.contains(&observation);
        assert_eq!(model.chars().any(|digit| digit != '0'), generated, "{observation}: {model:?}");
        assert!(!generated || models.insert(model), "{observation} has the model of another");
    }
}

#[test]
fn ablations_are_the_same_in_processes_and_replay_from_their_log() {
    for observation in ["per-frame", "dreamstream-clean-cache", "dreamstream-no-layout", "reprojected"] {
        let settings = [TINY, "--observation", observation, "--policy", "constant-velocity", "--duration", "1"];
        let (embedded, processes) = (drive(&settings), drive(&[&settings[..], &["--processes"]].concat()));
        for key in ["world_digest", "frame_digest", "driving_score"] {
            assert_eq!(embedded.episode(0)[key], processes.episode(0)[key], "{observation}: {key}");
        }
        let recording = embedded.recording(0);
        let replay = ["replay", recording.to_str().expect("UTF-8"), "--service", "vdm-worker", "--from-iteration", "2"];
        let output = dreamstream(&replay).output().expect("the binary runs");
        let told = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success() && told.contains(" 0 differ"), "{observation}: {told}");
    }
}

#[test]
fn a_source_whose_weights_do_not_ship_is_refused_with_the_command_that_makes_them() {
    if std::path::Path::new("configs/models/arms/no_guidance.safetensors").exists() {
        return;
    }
    let output = dreamstream(&["run", TINY, "--observation", "dreamstream-no-guidance"]).output().expect("runs");
    let told = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(64), "{told}");
    assert!(told.contains("no_guidance.safetensors") && told.contains("just arms"), "{told}");
}

#[test]
fn a_published_model_drives_and_replays() {
    let model = ["--model", "configs/models/wan-smoke.toml", "--video-backend", "framework"];
    let settings = ["--observation", "dreamstream", "--policy", "constant-velocity", "--duration", "3"];
    let drive = drive(&[&[TINY][..], &model, &settings].concat());
    check_episode(drive.episode(0), 30);
    let recording = drive.recording(0);
    let recording = recording.to_str().expect("UTF-8");
    for from in ["0", "4"] {
        let replay = ["replay", recording, "--service", "vdm-worker", "--from-iteration", from];
        let output = dreamstream(&[&replay[..], &model].concat()).output().expect("the binary runs");
        let told = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success() && told.contains(" 0 differ"), "{told}");
    }
}

#[test]
fn the_log_replay_policy_follows_the_log() {
    let drive = drive(&["scenarios/base", "--policy", "log-replay", "--observation", "layout", "--workers", "2"]);
    let episodes = drive.results["episodes"].as_array().expect("a list");
    assert_eq!(episodes.len(), 8);
    for episode in episodes {
        check_episode(episode, 80);
        let route = episode["route_completion"].as_f64();
        assert!(route.is_some_and(|share| share > 0.9), "{episode}");
        assert!(episode["driving_score"].as_f64().is_some_and(|score| score > 0.5), "{episode}");
        assert_eq!(episode["sub_scores"]["collision"], 1.0, "{episode}");
    }
}

#[test]
fn real_drives_are_imported_and_driven_alike_embedded_and_as_processes() {
    let Some(folder) = shared("data/nuscenes-mini-scenarios") else { return };
    let out = tempfile::tempdir().expect("a temporary folder");
    let imported = out.path().to_str().expect("UTF-8");
    let output = dreamstream(&["import", "scenarionet"]).arg(&folder).arg("-o").arg(imported).output().expect("runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let files: Vec<_> = std::fs::read_dir(out.path()).expect("folder").flatten().map(|entry| entry.path()).collect();
    assert_eq!(files.iter().filter(|path| path.to_string_lossy().ends_with(".scenario.json")).count(), 6);
    for (scene, observation) in [("0061", "dreamstream"), ("0103", "reference")] {
        let file = files.iter().find(|path| path.to_string_lossy().contains(scene)).expect("the scene is imported");
        let file = file.to_str().expect("UTF-8");
        let embedded = drive(&[file, "--observation", observation]);
        let processes = drive(&[file, "--observation", observation, "--processes"]);
        check_episode(embedded.episode(0), 80);
        check_episode(processes.episode(0), 80);
        assert_eq!(embedded.episode(0)["world_digest"], processes.episode(0)["world_digest"]);
        assert_eq!(embedded.episode(0)["sub_scores"], processes.episode(0)["sub_scores"]);
        for key in ["route_completion", "driving_score", "mean_score", "lost"] {
            assert_eq!(embedded.episode(0)[key], processes.episode(0)[key]);
        }
    }
}

#[test]
fn logs_of_argoverse_2_are_imported_and_driven() {
    let Some(folder) = shared("data/argoverse2") else { return };
    let out = tempfile::tempdir().expect("a temporary folder");
    let imported = out.path().to_str().expect("UTF-8");
    let output = dreamstream(&["import", "argoverse2"]).arg(&folder).arg("-o").arg(imported).output().expect("runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let drive = drive(&[imported, "--policy", "log-replay", "--observation", "layout", "--duration", "3"]);
    let episodes = drive.results["episodes"].as_array().expect("a list");
    assert_eq!(episodes.len(), 3);
    episodes.iter().for_each(|episode| check_episode(episode, 30));
}

#[test]
fn scenes_of_commonroad_are_imported_and_driven_to_their_end() {
    let made = workspace().join("crates/drive/import/tests/data/crossing.commonroad.xml");
    let out = tempfile::tempdir().expect("a temporary folder");
    let imported = out.path().to_str().expect("UTF-8");
    for ego in [&[][..], &["--ego", "recorded"]] {
        let output =
            dreamstream(&["import", "commonroad"]).arg(&made).args(["-o", imported]).args(ego).output().expect("runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    if let Some(folder) = shared("data/commonroad-ngsim") {
        let output = dreamstream(&["import", "commonroad"]).arg(&folder).args(["-o", imported]).output().expect("runs");
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success() && said.contains("drawn, not recorded"), "{said}");
    }
    let drive = drive(&[imported, "--policy", "lattice", "--observation", "layout"]);
    let episodes = drive.results["episodes"].as_array().expect("a list");
    for episode in episodes {
        let ticks = match episode["scenario"].as_str().expect("a name") {
            "ZAM_Crossing-1_1_T-1" | "USA_US101-4_1_T-1" => 80,
            "ZAM_Crossing-1_1_T-1-ego501" => 70,
            "USA_Lanker-1_1_T-1" => 40,
            other => panic!("{other} was not imported"),
        };
        check_episode(episode, ticks);
    }
    assert!(episodes.len() >= 2, "{episodes:?}");
}

#[test]
fn a_recording_replays_through_every_service_and_is_viewed() {
    let drive = drive(&[TINY, "--duration", "3"]);
    check_episode(drive.episode(0), 30);
    let recording = drive.recording(0);
    for service in ["sim-server", "layout-render", "vdm-worker", "policy-bridge"] {
        let output = dreamstream(&["replay", "--service", service]).arg(&recording).output().expect("runs");
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(output.status.success() && said.contains(" 0 differ"), "{service}: {said}");
    }
    for (service, iteration) in [("sim-server", "3"), ("vdm-worker", "3")] {
        let mut command = dreamstream(&["replay", "--service", service, "--from-iteration", iteration]);
        let output = command.arg(&recording).output().expect("runs");
        assert!(output.status.success(), "{service}: {}", String::from_utf8_lossy(&output.stderr));
    }
    let saved = drive.folder.path().join("drive.rrd");
    let output = dreamstream(&["view"]).arg(&recording).arg("--save").arg(&saved).output().expect("runs");
    let said = String::from_utf8_lossy(&output.stderr);
    if std::path::Path::new(env!("CARGO_BIN_EXE_dreamstream")).with_file_name("viewer").exists() {
        assert!(output.status.success(), "{said}");
        assert!(std::fs::metadata(&saved).is_ok_and(|file| file.len() > 10_000));
    } else {
        assert!(!output.status.success() && said.contains("cargo build --locked -p dreamstream -p viewer"), "{said}");
    }
}

//! The way of a video model through the commands: clips, every stage of training, a kill and a resume, shipped weights,
//! a first frame, a drive on them, and an evaluation; what is wrong is refused with the name of what is wrong.

use std::path::Path;
use std::process::{Output, Stdio};

use crate::harness::{dreamstream, signal, wait_for, workspace};
use ds_raster::RgbImage;
use serde_json::Value;

const SCENARIO: &str = "scenarios/base/free-curve.scenario.json";

/// Runs a command that must succeed, and returns what it says.
fn said(arguments: &[&str]) -> String {
    let output = dreamstream(arguments).output().expect("the binary runs");
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Runs a command that must fail, and returns its complaint.
fn refused(arguments: &[&str]) -> String {
    let Output { status, stderr, .. } = dreamstream(arguments).output().expect("the binary runs");
    assert!(!status.success(), "{arguments:?} was accepted");
    String::from_utf8_lossy(&stderr).into_owned()
}

fn path(folder: &Path, name: &str) -> String {
    folder.join(name).display().to_string()
}

/// Renders the smoke recipe's three sets.
fn render(folder: &Path) {
    for part in ["", "_broad", "_diverse"] {
        let out = path(folder, &format!("clips{part}"));
        let told = said(&["data", "render", "--config", &format!("configs/data/smoke{part}.toml"), "--out", &out]);
        assert!(told.contains("contact sheet"), "{told}");
    }
}

/// Writes the smoke recipe with few steps and its folders in a temporary one.
fn recipe(folder: &Path, name: &str) -> String {
    let text = std::fs::read_to_string(workspace().join("configs/train/smoke.toml")).expect("the smoke recipe");
    let text = text
        .replace("../models/smoke.toml", &path(folder, "model.toml"))
        .replace("training/smoke", &path(folder, name))
        .replace("training/data/smoke", &path(folder, "clips"))
        .replace("steps = 60", "steps = 8")
        .replace("steps = 40", "steps = 6")
        .replace("steps = 80", "steps = 6")
        .replace("checkpoint_every = 20", "checkpoint_every = 2");
    let file = path(folder, &format!("{name}.toml"));
    std::fs::write(&file, text).expect("writes");
    std::fs::copy(workspace().join("configs/models/smoke.toml"), folder.join("model.toml")).expect("a preset");
    file
}

/// Trains a stage, kills it once it has a checkpoint, and starts it again.
fn killed_and_resumed(recipe: &str, work: &Path) {
    let mut stage = dreamstream(&["train", "autoencoder", "--config", recipe]);
    let mut child = stage.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("starts");
    wait_for("a checkpoint", 120, || {
        let files = std::fs::read_dir(work).ok()?.filter_map(Result::ok);
        files.map(|file| file.file_name()).find(|name| name.to_string_lossy().contains("checkpoint")).map(|_| ())
    });
    signal(child.id(), "KILL");
    child.wait().expect("ends");
    said(&["train", "autoencoder", "--config", recipe]);
}

#[test]
fn a_model_is_trained_shipped_driven_and_measured_by_the_commands() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let folder = folder.path();
    render(folder);
    let listed = said(&["data", "list", &path(folder, "clips_diverse")]);
    assert_eq!(listed.lines().count(), 12, "{listed}");

    let whole = recipe(folder, "whole");
    assert!(said(&["train", "plan", "--config", &whole]).contains("planned"));
    let told = said(&["train", "all", "--config", &whole]);
    for stage in ["autoencoder", "prior", "teacher", "ode", "self-forcing", "decoder"] {
        assert!(told.contains(&format!("{stage}: ")), "{stage} is missing: {told}");
    }
    assert!(folder.join("whole/index.html").exists() || told.contains("losses and samples"), "{told}");
    let cut = recipe(folder, "cut");
    killed_and_resumed(&cut, &folder.join("cut"));
    let bytes = |name: &str| std::fs::read(folder.join(name).join("autoencoder.safetensors")).expect("weights");
    assert!(bytes("whole") == bytes("cut"), "a killed training ends in other weights");

    let student = path(folder, "model.safetensors");
    said(&["train", "ship", "--config", &whole, "--weights", &student]);
    let teacher = path(folder, "teacher.safetensors");
    said(&["train", "ship", "--config", &whole, "--of", "teacher", "--weights", &teacher]);
    let (preset, first) = (path(folder, "model.toml"), path(folder, "first.png"));
    said(&["video", "first-frame", SCENARIO, "--model", &preset, "--weights", &teacher, "--steps", "2", "-o", &first]);
    let frame = RgbImage::photo(&std::fs::read(&first).expect("a picture")).expect("a picture");
    assert!(frame.rgb().iter().any(|value| *value != frame.rgb()[0]), "one colour all over");

    measured(folder, &preset, &student);
}

/// Evaluates weights by a small configuration.
fn measured(folder: &Path, preset: &str, weights: &str) {
    let models = workspace().join("configs/models").canonicalize().expect("the models");
    let network = |name: &str| models.join(format!("{name}.safetensors")).display().to_string();
    let text = format!(
        "version = 1\nout = {:?}\nresamples = 20\n[perception]\nsegmenter = {:?}\nlights = {:?}\nlook = {:?}\n\
         [arms.one]\nkind = \"student\"\nmodel = {preset:?}\nweights = {weights:?}\n\
         [columns]\nfirst_seed = 20_000_000\nscenarios = 2\nlook = \"daylight\"\n\
         [layout]\niou = {{ student = \"one\" }}\nfeature_distance = {{ layout_guidance = \"one\" }}\n\
         starts = [0]\nframes = 8\nfirst = 4\nevery = 2\n",
        path(folder, "eval"),
        network("segmenter"),
        network("lights"),
        network("look"),
    );
    let config = path(folder, "eval.toml");
    std::fs::write(&config, &text).expect("writes");
    said(&["video", "eval", "--config", &config, "--only", "layout"]);
    let json = std::fs::read_to_string(folder.join("eval/eval.json")).expect("figures");
    let figures: Value = serde_json::from_str(&json).expect("JSON");
    assert!(json.contains("layout_iou") && figures.is_object(), "{json}");
    assert!(folder.join("eval/index.html").exists());
    std::fs::write(&config, text.replace("layout_guidance", "layout_gidance")).expect("writes");
    let complaint = refused(&["video", "eval", "--config", &config]);
    assert!(complaint.contains("layout_gidance"), "{complaint}");
}

#[test]
fn wrong_recipes_and_files_are_named() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let folder = folder.path();
    let recipe = recipe(folder, "work");
    let complaint = refused(&["train", "autoencoder", "--config", &recipe]);
    assert!(complaint.contains("clips"), "{complaint}");
    let complaint = refused(&["train", "unpack", "--config", &recipe]);
    assert!(complaint.contains("--of STAGE and --weights FILE"), "{complaint}");
    let complaint = refused(&["data", "render", "--config", "configs/data/absent.toml"]);
    assert!(complaint.contains("absent.toml"), "{complaint}");
    let complaint = refused(&["data", "list", &path(folder, "nowhere")]);
    assert!(complaint.contains("nowhere"), "{complaint}");
    let complaint = refused(&["video", "first-frame", SCENARIO, "--weights", &recipe]);
    assert!(complaint.contains("work.toml"), "{complaint}");
}

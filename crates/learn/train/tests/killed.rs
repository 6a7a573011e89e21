//! A training process that is killed in the middle of a stage and started again ends with the weights of one that was
//! not, bit for bit. Without the test harness: the process that trains is this program, started again.

use std::io::{BufRead, BufReader};
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use ds_nn::safetensors::WeightsFile;
use ds_train::{Stage, TrainConfig};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../..");
/// The first argument of the process that trains.
const TRAIN: &str = "train";
const STEPS: u32 = 60;
/// The signal that no process can catch.
const SIGKILL: i32 = 9;

struct NoBar;

impl ds_clips::Progress for NoBar {
    fn made(&self, _clips: u64, _of: u64) {}
}

/// Writes the smoke recipe for a work folder: few steps of the autoencoder, `STEPS` of the teacher, a checkpoint after
/// every second.
fn recipe(folder: &Path, clips: &Path, name: &str) -> PathBuf {
    let text = include_str!("../../../../configs/train/smoke.toml")
        .replace("../models", &format!("{ROOT}/configs/models"))
        .replace("training/smoke", &folder.join(name).display().to_string())
        .replace("training/data/smoke", &clips.display().to_string())
        .replacen("steps = 60", "steps = 4", 1)
        .replacen("steps = 80", &format!("steps = {STEPS}"), 1)
        .replace("replay = [\"broad\"]", "replay = []")
        .replace("checkpoint_every = 20", "checkpoint_every = 2");
    let path = folder.join(format!("{name}.toml"));
    std::fs::write(&path, text).expect("writes");
    path
}

/// Starts this program again as the process that trains.
fn train(recipe: &Path, stages: &[&str]) -> Command {
    let mut command = Command::new(std::env::current_exe().expect("this program has a path"));
    command.arg(TRAIN).arg(recipe).args(stages).stdin(Stdio::null()).stdout(Stdio::null());
    command
}

struct Lines;

impl ds_train::Progress for Lines {
    fn step(&mut self, step: u32, total: u32, _loss: f32, _figures: &[(&str, f32)]) {
        eprintln!("step {step}/{total}");
    }

    fn note(&mut self, text: &str) {
        eprintln!("{text}");
    }
}

fn work(recipe: &str, stages: &[String]) {
    let config = TrainConfig::load(Path::new(recipe)).expect("the recipe is valid");
    for name in stages {
        let stage = Stage::ALL.into_iter().find(|stage| stage.name() == name).expect("a stage");
        stage.run(&config, &mut Lines).expect("trains");
    }
}

fn finish(recipe: &Path, stages: &[&str]) {
    let output = train(recipe, stages).output().expect("starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.as_slice() {
        [word, recipe, stages @ ..] if word == TRAIN => work(recipe, stages),
        _ => a_process_that_was_killed_goes_on_to_the_same_weights(),
    }
}

fn a_process_that_was_killed_goes_on_to_the_same_weights() {
    let folder = tempfile::tempdir().expect("a folder");
    let clips = folder.path().join("clips");
    let data = ds_clips::Recipe::load(&Path::new(ROOT).join("configs/data/smoke.toml")).expect("the recipe is valid");
    ds_clips::render(&data, &clips, &NoBar).expect("renders");
    let whole = recipe(folder.path(), &clips, "whole");
    finish(&whole, &["autoencoder", "teacher"]);

    let killed = recipe(folder.path(), &clips, "killed");
    finish(&killed, &["autoencoder"]);
    let mut child = train(&killed, &["teacher"]).stderr(Stdio::piped()).spawn().expect("starts");
    let mut lines = BufReader::new(child.stderr.take().expect("piped")).lines();
    // Said in the third step: the checkpoint of the second is stored.
    let begun = lines.by_ref().map_while(Result::ok).find(|line| line.starts_with("step 3/"));
    child.kill().expect("it is still there");
    let status = child.wait().expect("ends");
    assert_eq!((begun.is_some(), status.signal()), (true, Some(SIGKILL)), "{status}");

    let weights = |name: &str, file: &str| {
        let path = folder.path().join(name).join(file);
        WeightsFile::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    };
    let left = weights("killed", "teacher.checkpoint.safetensors");
    let made: u32 = left.metadata["step"].parse().expect("a number");
    assert!((2..STEPS).contains(&made), "{made} of {STEPS} steps were stored");

    finish(&killed, &["teacher"]);
    for file in ["teacher.safetensors", "teacher.checkpoint.safetensors"] {
        let (whole, killed) = (weights("whole", file), weights("killed", file));
        assert_eq!(whole.metadata["step"], STEPS.to_string());
        assert_eq!(whole.weights.digest(), killed.weights.digest(), "{file}");
    }
    let bytes = |name: &str| std::fs::read(folder.path().join(name).join("teacher.safetensors")).expect("reads");
    assert!(bytes("whole") == bytes("killed"));
}

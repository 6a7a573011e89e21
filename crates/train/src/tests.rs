//! The whole video recipe in miniature, on rendered clips: every stage runs, stops, resumes, improves and ships.

use std::path::Path;
use std::sync::Arc;

use ds_clips::{ClipSet, Recipe};
use ds_nn::safetensors::WeightsFile;
use ds_raster::RgbImage;
use ds_space::Digest;
use ds_video::VideoModel;

use crate::first_frame::{Request, first_frame};
use crate::{Progress, Silent, Stage, TrainConfig, TrainError, batch, decoder, evaluate, page};

struct StopAt(u32, u32);

impl Progress for StopAt {
    fn step(&mut self, step: u32, _total: u32, _loss: f32, _figures: &[(&str, f32)]) {
        self.1 = step;
    }
    fn note(&mut self, _text: &str) {}
    fn stop(&self) -> bool {
        self.1 >= self.0
    }
}

struct NoBar;

impl ds_clips::Progress for NoBar {
    fn made(&self, _clips: u64, _of: u64) {}
}

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

/// The smoke recipe with its work folder in a temporary one.
fn recipe(folder: &Path) -> String {
    let text = include_str!("../../../configs/train/smoke.toml");
    text.replace("../models", &format!("{ROOT}/configs/models"))
        .replace("training/smoke", &folder.join("work").display().to_string())
        .replace("training/data/smoke", &folder.join("clips").display().to_string())
}

fn load(folder: &Path, text: &str) -> Result<TrainConfig, TrainError> {
    let path = folder.join("train.toml");
    std::fs::write(&path, text).expect("writes");
    TrainConfig::load(&path)
}

fn render(folder: &Path) {
    for part in ["", "_broad", "_diverse"] {
        let path = Path::new(ROOT).join(format!("configs/data/smoke{part}.toml"));
        let recipe = Recipe::load(&path).expect("the recipe is valid");
        ds_clips::render(&recipe, &folder.join(format!("clips{part}")), &NoBar).expect("renders");
    }
}

fn weights(config: &TrainConfig, stage: &str) -> ds_nn::Weights {
    let path = config.folder.join(format!("{stage}.safetensors"));
    WeightsFile::read(&path).expect("the stage wrote its weights").weights
}

/// Mean loss of a network over the first and the last fifth of a stage's log.
fn losses(config: &TrainConfig, stage: &str, network: &str) -> (f64, f64) {
    let text = std::fs::read_to_string(config.folder.join(format!("{stage}.jsonl"))).expect("a log");
    let parsed = text.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).expect("JSON"));
    let losses: Vec<f64> = parsed.filter_map(|line| line[network]["loss"].as_f64()).collect();
    let fifth = losses.len().div_ceil(5);
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    (mean(&losses[..fifth]), mean(&losses[losses.len() - fifth..]))
}

/// How far rollouts with the clips' own layouts are from the true frames, decibels (higher is nearer).
fn psnr(config: &TrainConfig, student: &ds_nn::Weights, stage: &str) -> f32 {
    let model = Arc::new(decoder::assembled(config, student, stage).expect("fits"));
    let clips = ClipSet::open(&config.sets["clips"]).expect("opens");
    let each = |index: usize| {
        let clip = clips.whole(index).expect("reads");
        let frames = evaluate::roll(&model, &clip, &clip.layouts, &Digest::of(b"key")).expect("rolls");
        batch::psnr_db(&clip.frames[1..], &frames[1..])
    };
    (0..4).map(each).sum::<f32>() / 4.0
}

#[test]
fn every_stage_runs_improves_and_ships() {
    let folder = tempfile::tempdir().expect("a folder");
    render(folder.path());
    let config = load(folder.path(), &recipe(folder.path())).expect("the recipe is valid");
    for stage in Stage::ALL.into_iter().filter(|stage| *stage != Stage::Ship) {
        stage.run(&config, &mut Silent).unwrap_or_else(|error| panic!("{}: {error}", stage.name()));
    }
    for (stage, network) in
        [("autoencoder", "model"), ("prior", "model"), ("teacher", "model"), ("ode", "model"), ("decoder", "model")]
    {
        let (first, last) = losses(&config, stage, network);
        assert!(last < first, "{stage}: {first} to {last}");
    }
    let teacher = psnr(&config, &weights(&config, "teacher"), "autoencoder");
    let (student, guided) = (weights(&config, "ode"), weights(&config, "self_forcing"));
    let (ode, forced) = (psnr(&config, &student, "autoencoder"), psnr(&config, &guided, "autoencoder"));
    assert!(ode > teacher + 0.5, "a teacher sampled in few steps has {teacher} dB, the student {ode}");
    assert!(forced > ode - 1.0, "self forcing keeps what was learned: {ode} to {forced}");
    let shipped = folder.path().join("shipped.safetensors");
    crate::ship::run(&config, (None, Some(&shipped)), &mut Silent).expect("ships");
    assert!(VideoModel::load(&config.model().expect("valid"), &shipped).is_ok());
    crate::ship::run(&config, (Some("teacher"), Some(&shipped)), &mut Silent).expect("ships");
    let mut other = config.clone();
    other.folder = folder.path().join("other");
    crate::ship::unpack(&other, "teacher", &shipped, &mut Silent).expect("unpacks");
    let (whole, half) = (weights(&config, "teacher"), weights(&other, "teacher"));
    for ((name, whole), (same, half)) in whole.iter().zip(half.iter()) {
        let far = whole.values().iter().zip(half.values()).any(|(a, b)| (a - b).abs() > 1e-3 * a.abs().max(0.1));
        assert!(name == same && !far, "{name}");
    }
    crate::ship::unpack(&other, "teacher", &shipped, &mut Silent).expect("the same once more");
    let taken = crate::ship::unpack(&config, "teacher", &shipped, &mut Silent).expect_err("the stage has been trained");
    assert!(taken.to_string().contains("already"), "{taken}");
    let model = config.model().expect("valid");
    let layout = RgbImage::filled(model.video.width_px, model.video.height_px, ds_layout::colour::LANE);
    let first = |seed: &[u8]| {
        let (key, prompt) = (Digest::of(seed), "driving at night");
        let request = Request { layout: &layout, prompt, key, steps: 4, guidance: 2.0 };
        first_frame(&model, &shipped, &request).expect("finite")
    };
    assert!(first(b"one") == first(b"one") && first(b"one") != first(b"other"));
    let page = std::fs::read_to_string(page::write(&config).expect("writes")).expect("reads");
    assert!(page.contains("self forcing") && page.matches("<polyline").count() >= 7, "{}", page.len());
}

#[test]
fn the_graph_trains_as_the_processors_loops_do() {
    let folder = tempfile::tempdir().expect("a folder");
    render(folder.path());
    let steps = |text: &str, from: u32| text.replace(&format!("steps = {from}"), "steps = 3");
    let text = [60, 80, 40, 10, 20].into_iter().fold(recipe(folder.path()), |text, from| steps(&text, from));
    let text = text.replace("count = 8", "count = 2");
    let own = load(folder.path(), &text).expect("valid");
    let framework =
        format!("{text}\n").replace("/work\"", "/graph\"").replace("seed = 1\n", "seed = 1\nbackend = \"framework\"\n");
    let graph = load(folder.path(), &framework).expect("valid");
    assert_ne!((own.backend, &own.folder), (graph.backend, &graph.folder));
    for stage in Stage::ALL.into_iter().filter(|stage| *stage != Stage::Ship) {
        for config in [&own, &graph] {
            stage.run(config, &mut Silent).unwrap_or_else(|error| panic!("{}: {error}", stage.name()));
        }
    }
    for (stage, network) in [
        ("autoencoder", "model"),
        ("teacher", "model"),
        ("ode", "model"),
        ("self_forcing", "critic"),
        ("decoder", "model"),
    ] {
        let ((_, own), (_, graph)) = (losses(&own, stage, network), losses(&graph, stage, network));
        assert!((own - graph).abs() < 1e-2 * own.abs(), "{stage}: {own}, {graph}");
    }
}

#[test]
fn a_stopped_run_ends_as_one_that_was_not() {
    let (a, b) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    render(a.path());
    // The same clips for both, fewer steps than the recipe's.
    let fewer = |folder: &Path| {
        let text = recipe(folder).replace("steps = 60", "steps = 6").replace("steps = 80", "steps = 6");
        let text = text.replace("steps = 40", "steps = 6").replace("steps = 10", "steps = 6");
        let clips = folder.join("clips").display().to_string();
        text.replace(&clips, &a.path().join("clips").display().to_string())
    };
    let whole = load(a.path(), &fewer(a.path())).expect("valid");
    let parts = load(b.path(), &fewer(b.path())).expect("valid");
    let stages =
        [Stage::Autoencoder, Stage::Prior, Stage::Teacher, Stage::Trajectories, Stage::Ode, Stage::SelfForcing];
    for stage in stages {
        stage.run(&whole, &mut Silent).expect("trains");
        stage.run(&parts, &mut StopAt(3, 0)).expect("trains");
        stage.run(&parts, &mut Silent).expect("resumes");
        if stage != Stage::Trajectories {
            let name = stage.name().replace('-', "_");
            assert_eq!(weights(&whole, &name).digest(), weights(&parts, &name).digest(), "{name}");
        }
    }
}

#[test]
fn a_stage_without_its_inputs_says_what_is_missing() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = load(folder.path(), &recipe(folder.path())).expect("valid");
    let check = |stage: Stage, expected: &str| {
        let error = stage.run(&config, &mut Silent).expect_err("it has nothing to work on");
        let mut message = error.to_string();
        let mut source = std::error::Error::source(&error);
        while let Some(inner) = source {
            message += &format!(": {inner}");
            source = inner.source();
        }
        assert!(message.contains(expected), "{message:?} lacks {expected:?}");
    };
    check(Stage::Autoencoder, "index.json");
    check(Stage::Prior, "autoencoder.safetensors");
    check(Stage::Trajectories, "teacher.safetensors");
    check(Stage::SelfForcing, "ode.safetensors");
    assert!(TrainConfig::load(&folder.path().join("absent.toml")).is_err());
}

#[test]
fn trajectories_of_another_teacher_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    render(folder.path());
    let text = recipe(folder.path()).replace("steps = 60", "steps = 2").replace("steps = 80", "steps = 2");
    let config = load(folder.path(), &text.replace("count = 8", "count = 2")).expect("valid");
    for stage in [Stage::Autoencoder, Stage::Teacher, Stage::Trajectories] {
        stage.run(&config, &mut Silent).expect("runs");
    }
    let again = load(folder.path(), &text.replace("guidance = 1.5\nreject", "guidance = 3.0\nreject")).expect("valid");
    let error = Stage::Trajectories.run(&again, &mut Silent).expect_err("another guidance");
    assert!(error.to_string().contains("another recipe or teacher"), "{error}");
}

#[test]
fn recipes_inherit_table_by_table() {
    let folder = tempfile::tempdir().expect("a folder");
    let base = load(folder.path(), &recipe(folder.path())).expect("valid");
    let arm = folder.path().join("arm.toml");
    let text =
        "inherits = \"train.toml\"\nfolder = \"arm\"\nparent = \"whole\"\n[teacher]\ndropout = [\"layout\", \"all\"]\n";
    std::fs::write(&arm, text).expect("writes");
    let found = TrainConfig::load(&arm).expect("valid");
    let teacher = found.teacher.clone().expect("inherited");
    assert_eq!(teacher.dropout, [crate::config::Dropout::Layout, crate::config::Dropout::All]);
    assert_eq!(Some(&teacher.stage), base.teacher.as_ref().map(|teacher| &teacher.stage));
    assert_eq!((found.folder.as_path(), found.parent.as_deref()), (Path::new("arm"), Some(Path::new("whole"))));
    std::fs::write(&arm, "inherits = \"arm.toml\"").expect("writes");
    assert!(TrainConfig::load(&arm).expect_err("a ring").to_string().contains("inherit from each other"));
}

#[test]
fn broken_recipes_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let good = recipe(folder.path());
    let check = |from: &str, to: &str, expected: &str| {
        assert!(good.contains(from), "{from:?}");
        let message = load(folder.path(), &good.replacen(from, to, 1)).map(|_| String::new());
        let message = message.unwrap_or_else(|error| error.to_string());
        assert!(message.contains(expected), "{message:?} lacks {expected:?}");
    };
    check("version = 2", "version = 1", "version");
    check("learning_rate = 3e-3", "learning_rate = -1.0", "autoencoder");
    check("checkpoint_every = 20", "checkpoint_every = 0", "autoencoder");
    check("sets = [\"clips\"]", "sets = [\"clip\"]", "\"clip\" is not among");
    check("rollout = 4", "rollout = 2", "self_forcing");
    check("reject = 0.2", "reject = 1.0", "trajectories");
    check("seed = 1", "sed = 1", "cannot be read");
    check("dropout = [\"layout\"]", "dropout = [\"layout\"]\ndropped = 1", "cannot be read");
    check("dropout = [\"layout\"]", "dropout = [\"all\"]", "unconditional");
    check("replay = [\"broad\"]", "replay = [\"clip\"]", "\"clip\" is not among");
    check("trunk_rate = 0.8", "trunk_rate = 2.0", "trunk_rate");
    let standard = "seed = 1\nkeep_look = true\nunconditional = \"all\"";
    check("seed = 1", standard, "unconditional");
    assert!(
        load(folder.path(), &good.replacen("seed = 1", standard, 1).replace("[\"layout\"]", "[\"all\"]"))
            .is_err_and(|error| error.to_string().contains("keep_look"))
    );
    check("dropout = [\"layout\"]", "dropout = [\"layout\"]\ndropout_share = 1.0", "dropout_share");
}

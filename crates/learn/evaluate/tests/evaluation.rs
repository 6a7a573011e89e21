//! A whole evaluation of the smallest preset with untrained weights: every key is there, what is stored is not rolled out
//! again, parts are measured apart, and wrong configurations are named.

use std::collections::BTreeSet;
use std::path::Path;

use ds_camera::ReferenceWorld;
use ds_evaluate::evaluation::{Evaluation, Part};
use ds_evaluate::outcome::Outcome;
use ds_evaluate::{EvalConfig, Progress, report};
use ds_nn::Weights;
use ds_nn::safetensors::WeightsFile;
use ds_perception::{Label, lights, look};
use ds_second_camera::SecondWorld;
use ds_space::Digest;
use ds_video::{ModelConfig, VideoModel};

const PRESET: &str = include_str!("../../../../configs/models/smoke.toml");
const TEXT: &str = r#"
version = 1
out = "out"
resamples = 20
[perception]
segmenter = "segmenter.safetensors"
lights = "lights.safetensors"
look = "look.safetensors"
[arms.one]
kind = "student"
model = "smoke.toml"
weights = "model.safetensors"
[arms.two]
kind = "student"
model = "smoke.toml"
weights = "model.safetensors"
cache_source = "clean"
[arms.blind]
kind = "no_layout"
model = "smoke.toml"
weights = "model.safetensors"
[arms.mirror]
kind = "autoencoder"
model = "smoke.toml"
weights = "model.safetensors"
[columns]
first_seed = 20_000_000
scenarios = 2
look = "daylight"
real = ["absent"]
[sharpness]
arms = { autoencoder = "mirror", student = "one" }
rollouts = 1
first = 3
last = 7
every = 2
[layout]
iou = { student = "one", no_layout = "blind" }
feature_distance = { layout_guidance = "one", no_guidance = "two" }
starts = [0, 30]
frames = 8
first = 4
every = 2
[drift]
arms = { early_timestep = "one", clean = "two" }
rollouts = 2
marks = [8, 16]
window = 4
pace = 0.75
directions = 3
shrinkage = 0.1
long = { rollouts = 1, frames = 60, from = 20 }
[appearance]
arms = { with = "one", without = "two" }
conditions = ["snow", "night"]
rollouts = 1
at = 8
window = 4
pace = 1.0
[speed]
model = "smoke.toml"
frames = 8
[videos]
arms = ["one"]
scenarios = 1
frames = 12
"#;

#[derive(Default)]
struct Count {
    rolled: u32,
    kept: u32,
    notes: String,
}

impl Progress for Count {
    fn ahead(&mut self, _rollouts: u64) {}

    fn done(&mut self, _what: &str, stored: bool) {
        if stored { self.kept += 1 } else { self.rolled += 1 }
    }

    fn note(&mut self, text: &str) {
        self.notes += text;
    }
}

/// Writes untrained weights of everything and returns the configuration.
fn prepare(folder: &Path) -> EvalConfig {
    let preset = ModelConfig::parse(PRESET).expect("the preset is right");
    let seed = Digest::of(b"evaluation test");
    let networks = [
        ("model", VideoModel::declare(&preset)),
        ("segmenter", ds_graph::segmenter::declare(Label::COUNT)),
        ("lights", lights::SHAPE.declare()),
        ("look", look::SHAPE.declare()),
    ];
    for (name, declared) in networks {
        let file = WeightsFile { weights: Weights::initialised(&declared, &seed), ..WeightsFile::default() };
        file.write(&folder.join(name).with_extension("safetensors")).expect("writes");
    }
    std::fs::write(folder.join("smoke.toml"), PRESET).expect("writes");
    let mut config = EvalConfig::parse(TEXT, folder).expect("the configuration is right");
    config.out = folder.join("out");
    config
}

fn measure(config: &EvalConfig, outcome: &mut Outcome, parts: &[Part]) -> Count {
    let mut count = Count::default();
    let ticks = std::cell::Cell::new(0.0);
    let seconds = || {
        ticks.set(ticks.get() + 0.5);
        ticks.get()
    };
    let mut evaluation = Evaluation::open(config, &[&ReferenceWorld, &SecondWorld], &mut count).expect("opens");
    evaluation.measure(outcome, &parts.iter().copied().collect::<BTreeSet<_>>(), &seconds).expect("measures");
    count
}

#[test]
fn every_key_is_there_and_a_repetition_rolls_nothing_out() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let config = prepare(folder.path());
    let mut outcome = Outcome::default();
    let first = measure(&config, &mut outcome, &Part::ALL);
    assert!(first.notes.contains("no logs at"), "{}", first.notes);
    report::write(&outcome, &config).expect("writes");
    let text = std::fs::read_to_string(config.out.join("eval.json")).expect("is there");
    let json: serde_json::Value = serde_json::from_str(&text).expect("is JSON");
    for target in ["lane", "crosswalk", "vehicle", "pedestrian"] {
        for key in ["student", "teacher", "no_layout"] {
            assert!(json["layout_iou"][target].get(key).is_some(), "{target}.{key}");
        }
    }
    assert!(json["layout_iou"]["lane"]["teacher"].is_null(), "no arm is the teacher");
    let named = json.pointer("/appearance_at_100/snow/named").and_then(serde_json::Value::as_object);
    assert!(named.is_some_and(|arms| !arms.is_empty()), "nothing says what frames are named");
    for path in [
        "/layout_iou/lane/student",
        "/feature_distance/layout_guidance",
        "/feature_distance/no_guidance",
        "/appearance_at_100/snow/with",
        "/appearance_at_100/night/without",
        "/sharpness/autoencoder/psnr_db",
        "/sharpness/student/laplacian_ratio",
        "/sharpness/student/border_ratio",
        "/sharpness/student/seam",
        "/frames_per_second",
        "/gemm_share",
        "/columns/B/layout_iou/lane/student",
        "/drift/early_timestep/rise",
        "/comparisons/distance_reduction_against_no_guidance",
    ] {
        let figure = json.pointer(path).unwrap_or_else(|| panic!("{path} is missing in {text}"));
        let [value, low, high] = ["value", "low", "high"].map(|key| figure[key].as_f64());
        assert!(value.is_some() && low <= high && figure["samples"].as_u64() >= Some(1), "{path}: {figure}");
    }
    for path in ["/feature_distance/standard_cfg", "/drift/clean/at_200", "/sharpness/autoencoder/seam"] {
        assert!(json.pointer(path).is_some_and(serde_json::Value::is_null), "{path}");
    }
    // Two chunks of four frames took half a second each by the clock that was handed in.
    assert_eq!(json["frames_per_second"]["value"].as_f64(), Some(8.0));
    let page = std::fs::read_to_string(config.out.join("index.html")).expect("is there");
    assert!(page.contains("Column B") && page.contains("videos/A-") && page.contains("<svg"));
    assert_eq!(outcome.videos.len(), 2);
    let gif = std::fs::read(config.out.join("videos").join(&outcome.videos[0])).expect("is there");
    assert_eq!(&gif[..6], b"GIF89a");
    assert!(
        config.out.join("videos").join(outcome.videos[0].replace(".gif", ".png")).exists() && page.contains(".png")
    );

    let mut again = Outcome::default();
    let second =
        measure(&config, &mut again, &[Part::Sharpness, Part::Layout, Part::Drift, Part::Appearance, Part::Videos]);
    assert_eq!((second.rolled, second.kept), (0, first.rolled + first.kept));
    again.speed.clone_from(&outcome.speed);
    assert_eq!(again, outcome, "the same inputs give the same figures");
    let earlier = report::earlier(&config.out).expect("reads");
    assert_eq!(earlier, outcome);
}

#[test]
fn wrong_configurations_are_named() {
    let check = |from: &str, to: &str, expected: &str| {
        assert!(TEXT.contains(from), "{from}");
        let error = EvalConfig::parse(&TEXT.replacen(from, to, 1), Path::new(".")).expect_err("it is wrong");
        let text = format!("{error} {:?}", std::error::Error::source(&error).map(ToString::to_string));
        assert!(text.contains(expected), "{text}");
    };
    check("version = 1", "version = 3", "version");
    check("student = \"one\"", "student = \"three\"", "there is no arm \"three\"");
    check("no_guidance =", "guidance =", "\"guidance\" is none of");
    check("first = 4", "first = 9", "first from 1 to frames");
    check("marks = [8, 16]", "marks = [16, 8]", "rising marks");
    check("directions = 3", "directions = 17", "directions within 1 to 16");
    check("cache_source = \"clean\"", "guidance = 2.0", "a teacher's");
    check("scenarios = 2", "scenarios = 0", "columns.scenarios");
    check("first_seed = 20_000_000", "first_seed = 18446744073709551615", "columns.first_seed");
    check("pace = 0.75", "paces = 0.75", "paces");
    check("\"night\"]", "\"nacht\"]", "nacht");
    let worded = |name: &str| {
        format!(
            "[first_frames]\nmodel = \"smoke.toml\"\nweights = \"model.safetensors\"\nsteps = 2\nguidance = 1.0\nscenarios = 1\n\
             wordings = {{ {name} = [\"a word\"] }}\n[speed]"
        )
    };
    check("[speed]", &worded("nacht"), "nacht");
    assert!(EvalConfig::parse(&TEXT.replacen("[speed]", &worded("night"), 1), Path::new(".")).is_ok());
}

#[test]
fn the_shipped_configurations_are_accepted_and_quick_is_less() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/eval");
    EvalConfig::load(&folder.join("looks_of_teachers.toml")).expect("it is right");
    let config = EvalConfig::load(&folder.join("shipped.toml")).expect("it is right");
    let quick = config.clone().quick();
    assert!(quick.columns.scenarios < config.columns.scenarios);
    assert!(quick.drift.is_some_and(|drift| drift.long.is_none() && drift.marks.iter().all(|mark| *mark <= 100)));
}

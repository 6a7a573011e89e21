//! Arms of the smallest preset: switching the layout off, replacing a transformer, a teacher's clip.

use std::path::Path;

use ds_camera::{Appearance, ReferenceWorld};
use ds_nn::safetensors::WeightsFile;
use ds_scenario::Family;
use ds_video::Layout;

use super::*;
use crate::drive::Route;

const PRESET: &str = include_str!("../../../../../configs/models/smoke.toml");

fn weights(seed: &[u8]) -> Weights {
    let preset = ModelConfig::parse(PRESET).expect("the preset is right");
    let mut weights = Weights::initialised(&VideoModel::declare(&preset), &Digest::of(seed));
    // Heads begin with zeros, to which every input is alike.
    for (index, (_, array)) in (0..).zip(weights.iter_mut()) {
        let draws = ds_space::Draws::from_seed(index, "arm test");
        for (at, value) in (0..).zip(array.values_mut()) {
            #[expect(clippy::cast_possible_truncation, reason = "weights are single precision")]
            let by = 0.05 * draws.normal(at) as f32;
            *value += by;
        }
    }
    weights
        .iter_mut()
        .filter(|(name, _)| *name == "vae.latent.std")
        .for_each(|(_, array)| array.values_mut().fill(1.0));
    weights
}

/// Writes a configuration with arms of each kind and returns it.
fn config(folder: &Path) -> EvalConfig {
    let save = |name: &str, weights: Weights| {
        let file = WeightsFile { weights, ..WeightsFile::default() };
        file.write(&folder.join(name)).expect("writes");
    };
    save("model.safetensors", weights(b"a"));
    save("teacher.safetensors", weights(b"b").part("dit."));
    let metadata = [("config_digest".to_owned(), "another".to_owned())].into();
    let elsewhere = WeightsFile { weights: weights(b"b"), metadata };
    elsewhere.write(&folder.join("elsewhere.safetensors")).expect("writes");
    std::fs::write(folder.join("smoke.toml"), PRESET).expect("writes");
    let arm = |name: &str, more: &str| {
        format!("[arms.{name}]\nmodel = \"smoke.toml\"\nweights = \"model.safetensors\"\n{more}\n")
    };
    let text = [
        "version = 1\nout = \"out\"\n[perception]\nsegmenter = \"s\"\nlights = \"l\"\nlook = \"k\"\n".to_owned(),
        "[columns]\nfirst_seed = 1\nscenarios = 1\nlook = \"day\"\n".to_owned(),
        arm("student", "kind = \"student\""),
        arm("clean", "kind = \"student\"\ncache_source = \"clean\""),
        arm("other", "kind = \"student\"\ndit = \"teacher.safetensors\""),
        arm("blind", "kind = \"no_layout\""),
        arm("alone", "kind = \"per_frame\""),
        arm("teacher", "kind = \"teacher\"\ndit = \"teacher.safetensors\"\nguidance = 2.0\nsteps = 2"),
        arm("prior", "kind = \"prior\"\ndit = \"teacher.safetensors\"\nsteps = 2"),
        arm("windows", "kind = \"teacher\"\ndit = \"teacher.safetensors\"\nguidance = 2.0\nsteps = 2\nwindow = 2"),
        arm("keeper", "kind = \"teacher\"\ndit = \"teacher.safetensors\"\nguidance = 2.0\nsteps = 2\nkeep_look = true"),
        arm("elsewhere", "kind = \"student\"\ndit = \"elsewhere.safetensors\""),
        arm("broken", "kind = \"student\"\ndit = \"smoke.toml\""),
    ];
    EvalConfig::parse(&text.concat(), folder).expect("the configuration is right")
}

fn drive() -> Drive {
    let scene = Arc::new(ds_scenario::generate(Family::LeadBraking, 1));
    let route = Route { scene, start: 0, pace: 1.0, look: Appearance::DAY, turned_deg: 0.0 };
    Drive::new(&ReferenceWorld, &route, (64, 32)).expect("a drive")
}

#[test]
fn arms_differ_in_what_their_configuration_says() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let config = config(folder.path());
    let arm = |name: &str| Arm::load(&config, name).expect("loads");
    let mut drive = drive();
    let mut roll = |name: &str| arm(name).roll(&mut drive, 8).expect("rolls out");
    let student = roll("student");
    assert_eq!(student.len(), 9);
    assert_eq!(student, roll("student"));
    assert_ne!(student, roll("clean"));
    assert_ne!(student, roll("other"));
    assert_ne!(student, roll("blind"));
    let teacher = roll("teacher");
    assert_eq!((teacher.len(), teacher == student), (9, false));
    assert_ne!(teacher, roll("keeper"));
    // The first window of two latents is nothing but a shorter clip; what follows has seen less.
    let windows = roll("windows");
    assert_eq!((windows.len(), windows == teacher), (9, false));
    assert_eq!(windows[..5], arm("windows").roll(&mut self::drive(), 4).expect("rolls out"));
    assert_ne!(student, roll("alone"));
    let names = ["student", "clean", "other", "blind", "alone", "teacher", "prior", "windows", "keeper"];
    let digests: std::collections::BTreeSet<_> = names.map(|name| arm(name).digest()).into_iter().collect();
    assert_eq!(digests.len(), names.len());
    for (name, says) in [("broken", "broken"), ("elsewhere", "another")] {
        let error = Arm::load(&config, name).err().expect("no fitting weights");
        let whole =
            format!("{error}: {}", std::error::Error::source(&error).map(ToString::to_string).unwrap_or_default());
        assert!(whole.contains(says), "{whole}");
    }
}

#[test]
fn without_a_layout_layouts_do_not_matter() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let config = config(folder.path());
    let mut drive = drive();
    let layouts: Vec<Layout> = (0..=4).map(|frame| drive.layout(frame).expect("renders")).collect();
    let black = vec![Layout::from(RgbImage::filled(64, 32, [0; 3])); 5];
    for (name, same) in [("blind", true), ("prior", true), ("student", false), ("teacher", false)] {
        let arm = Arm::load(&config, name).expect("loads");
        let roll = |layouts: &[Layout]| arm.roll_with(&drive, layouts).expect("rolls out");
        assert_eq!(roll(&layouts) == roll(&black), same, "{name}");
    }
}

#[test]
fn frames_made_one_by_one_know_no_other() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let config = config(folder.path());
    let mut drive = drive();
    let layouts: Vec<Layout> = (0..=6).map(|frame| drive.layout(frame).expect("renders")).collect();
    let mut others = vec![Layout::from(RgbImage::filled(64, 32, [0; 3])); 7];
    others[5] = layouts[5].clone();
    let roll = |arm: &Arm, layouts: &[Layout]| arm.roll_with(&drive, layouts).expect("rolls out");
    for (name, same) in [("alone", true), ("student", false)] {
        let arm = Arm::load(&config, name).expect("loads");
        let (frames, again) = (roll(&arm, &layouts), roll(&arm, &others));
        assert_eq!(frames[5] == again[5], same, "{name}");
        assert_ne!(frames[4], again[4], "{name} follows its layout");
    }
    // What `run` makes of a preset's own weights is what the arm of that kind makes.
    let (preset, weights) = (folder.path().join("smoke.toml"), folder.path().join("model.safetensors"));
    let other = folder.path().join("teacher.safetensors");
    for (source, name) in [
        (ObservationSource::PerFrame, "alone"),
        (ObservationSource::DreamstreamCleanCache, "clean"),
        (ObservationSource::DreamstreamNoLayout, "blind"),
        (ObservationSource::DreamstreamNoGuidance, "other"),
        (ObservationSource::Dreamstream, "student"),
    ] {
        let own = Arm::of_source(source, &preset, &weights, &other).expect("loads");
        assert!(roll(&own, &layouts) == roll(&Arm::load(&config, name).expect("loads"), &layouts), "{name}");
    }
    let absent = Arm::of_source(ObservationSource::DreamstreamNoGuidance, &preset, &weights, Path::new("none"));
    let cause = std::error::Error::source(&absent.err().expect("there is no file")).map(ToString::to_string);
    assert!(cause.is_some_and(|cause| cause.contains("`just arms`")));
}

#[test]
fn a_teacher_asks_for_whole_latents() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let arm = Arm::load(&config(folder.path()), "teacher").expect("loads");
    let error = arm.roll(&mut drive(), 6).expect_err("6 is no multiple of 4");
    let cause = std::error::Error::source(&error).map(ToString::to_string);
    assert!(cause.as_ref().is_some_and(|cause| cause.contains("1 + k·4")), "{cause:?}");
}

#[test]
fn weights_that_are_not_there_are_named_with_the_command_that_makes_them() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/eval");
    let mut config = EvalConfig::load(&folder.join("shipped.toml")).expect("it is right");
    config.arms.get_mut("clean").expect("an arm").dit = Some("absent.safetensors".into());
    let error = Arm::load(&config, "clean").err().expect("there is no such file");
    let cause = std::error::Error::source(&error).expect("a cause").to_string();
    assert!(cause.contains("absent.safetensors") && cause.contains("`just arms`"), "{cause}");
}

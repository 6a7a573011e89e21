//! Streams of other texture: what the generator does is learned from effect-free pairs; a strong effect is found, nothing
//! is found where nothing was injected, and what cannot be seen is listed with its limit.

use ds_diagnosis::Verdict;
use ds_frames::{FrameCase, Nuisance, Options, diagnose};

fn generated(folder: &std::path::Path, seed: u64, injected: &[(&str, &[f64])]) {
    crate::pair::write(folder, seed, injected);
    let path = folder.join("meta.json");
    let text = std::fs::read_to_string(&path).expect("meta.json");
    std::fs::write(&path, text.replacen('{', "{\"pairing\": \"same-layout\",", 1)).expect("meta.json");
}

#[test]
fn effects_are_judged_against_what_the_generator_does() {
    let root = tempfile::tempdir().expect("a folder");
    for seed in 20..28 {
        generated(&root.path().join(format!("free/{seed}")), seed, &[]);
    }
    let nuisance = Some(Nuisance::learn(&root.path().join("free")).expect("effect-free pairs"));
    let options = Options { nuisance, ..Options::default() };
    let told = |name: &str, seed, injected: &[(&str, &[f64])]| {
        generated(&root.path().join(name), seed, injected);
        diagnose(&FrameCase::read(&root.path().join(name)).expect("a case"), &options).expect("a diagnosis")
    };
    let free = told("none", 40, &[]);
    assert_eq!(free.verdict, Verdict::None, "{:?}", free.chosen);
    assert!(!free.detection_limits.is_empty());
    let curved = told("gamma", 41, &[("gamma", &[1.4])]);
    assert!(curved.chosen.iter().any(|c| c == "gamma"), "{:?}", curved.chosen);
}

#[test]
fn too_few_effect_free_pairs_are_refused_by_name() {
    let root = tempfile::tempdir().expect("a folder");
    generated(&root.path().join("free/1"), 1, &[]);
    let refused = Nuisance::learn(&root.path().join("free"));
    assert!(refused.is_err_and(|e| e.to_string().contains("too few effect-free pairs")));
}

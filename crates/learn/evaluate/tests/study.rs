//! The study `fidelity` without a video model: the reference camera is at distance 0 from itself, other sources are not,
//! what was looked at is kept, and the same configuration gives the same figures.

use std::path::{Path, PathBuf};

use ds_evaluate::Progress;
use ds_evaluate::study::{self, FidelityConfig, outcome::Outcome};

fn configs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs")
}

/// The shipped study, small and without the video model.
fn config(out: &Path) -> FidelityConfig {
    let mut config = FidelityConfig::load(&configs().join("study/fidelity.toml")).expect("the shipped study");
    config.sources.retain(|source| source.name() != "dreamstream");
    config.ratios.retain(|pair| pair.iter().all(|source| source.name() != "dreamstream"));
    config.video = None;
    (config.size_px, config.scenarios, config.frames, config.draws) = ((160, 96), 6, 16, 50);
    config.out = out.to_path_buf();
    config.check().expect("sound");
    config
}

#[derive(Default)]
struct Counted {
    made: u32,
    kept: u32,
}

impl Progress for Counted {
    fn ahead(&mut self, _rollouts: u64) {}
    fn done(&mut self, _what: &str, stored: bool) {
        if stored { self.kept += 1 } else { self.made += 1 }
    }
    fn note(&mut self, _text: &str) {}
}

fn study(config: &FidelityConfig) -> (Outcome, Counted) {
    let mut progress = Counted::default();
    let outcome = study::fidelity(config, &mut progress, &|| 0.0).expect("the study runs");
    (outcome, progress)
}

#[test]
fn the_reference_is_at_zero_and_what_was_looked_at_is_kept() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let config = config(folder.path());
    let (found, first) = study(&config);
    assert_eq!((first.made, first.kept), (18, 0), "6 scenarios × 3 sets");
    let row = |policy: &str, source: &str| &found.policies[policy].sources[source];
    let panel = ["camera", "drivor", "ltf"];
    for policy in panel.into_iter().chain(["camera-drawn"]) {
        assert!(row(policy, "reference").fd.value.abs() < 1e-6, "equal pixels");
        for source in ["sim-rgb", "layout"] {
            let row = row(policy, source);
            assert!(row.fd.value > 0.1 && row.fd.value <= row.bound * (1.0 + 1e-9), "{policy} {source}: {row:?}");
            assert!(row.fd.low < row.fd.high && row.placed.is_some() && row.bias > 0.0);
            assert!(row.warnings.iter().any(|warning| warning.contains("fewer")), "12 frames are few");
        }
    }
    // FDπ is of the panel alone, without its control.
    let mean = panel.iter().map(|policy| row(policy, "layout").fd.value).sum::<f64>() / 3.0;
    assert!((found.fd_pi["layout"].value - mean).abs() < 1e-9);
    assert_eq!(found.others["fd_look_clip"].features, 128);
    assert_eq!(found.worst["layout"].len(), 6);
    assert!(found.worst["layout"].windows(2).all(|pair| pair[0].apart >= pair[1].apart));
    study::write(&config, &found).expect("writes");
    let page = std::fs::read_to_string(folder.path().join("index.html")).expect("a page");
    assert!(page.contains("sim-to-reference") && page.contains("camera-drawn"));
    let picture = found.worst["layout"][0].picture.as_ref().expect("the worst scene is shown");
    assert!(folder.path().join("scenes").join(picture).exists());
    let (again, second) = study(&config);
    assert_eq!((second.made, second.kept), (0, 18));
    assert_eq!(again, found);
}

#[test]
fn wrong_studies_are_named() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let base = config(folder.path());
    let check = |change: fn(&mut FidelityConfig), words: &str| {
        let mut config = base.clone();
        change(&mut config);
        let error = config.check().expect_err(words).to_string();
        assert!(error.contains(words), "{error}");
    };
    check(|config| config.every = 4, "every");
    check(|config| config.scenarios = 1, "scenarios");
    check(|config| config.panel.iter_mut().for_each(|member| member.control = true), "panel");
    check(|config| config.sources.push(study::config::Source::Layout), "twice");
    check(|config| config.sources.push(study::config::Source::Dreamstream), "video");
    check(|config| config.ratios.push([study::config::Source::Dreamstream; 2]), "ratios");
    let mut config = base.clone();
    config.panel[0].policy = "lattice".to_owned();
    let error = study::fidelity(&config, &mut Counted::default(), &|| 0.0).expect_err("no features").to_string();
    assert!(error.contains("lattice") && error.contains("no features"), "{error}");
}

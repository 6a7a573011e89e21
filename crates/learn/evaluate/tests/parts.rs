//! The study `parts` without a video model: the reference differs from itself in nothing, parts of other frames do, what was
//! planned is kept, and figures do not depend on how many plan.

use std::path::Path;

use ds_evaluate::EvaluationError;
use ds_evaluate::study::{self, Study, StudyConfig, outcome::Outcome};

use crate::study::{Counted, by};

/// The shipped study, small, without the video model, with drawn weights.
fn config(out: &Path) -> StudyConfig {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/study/parts.toml");
    let mut config = StudyConfig::load(&path).expect("the shipped study");
    config.sources = ["reference", "sim-rgb"].map(source).to_vec();
    (config.video, config.panel[0].weights) = (None, None);
    (config.size_px, config.scenarios, config.frames, config.draws, config.clip) = ((160, 96), 3, 12, 20, 2);
    config.out = out.to_path_buf();
    config
}

fn source(name: &str) -> study::config::Source {
    study::config::Source::try_from(toml::Value::String(name.to_owned())).expect("a sound source")
}

fn run(config: &StudyConfig, workers: usize) -> Result<(Outcome, Counted), Box<EvaluationError>> {
    let mut counted = Counted::default();
    let found = by(Some(workers), Study::Parts, config, &mut counted)?;
    Ok((found, counted))
}

#[test]
fn parts_of_frames_make_plans_differ_and_the_reference_does_not() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let config = config(folder.path());
    let (found, first) = run(&config, 2).expect("the study runs");
    assert_eq!((first.made, first.kept), (6, 0), "3 scenarios × 2 sources");
    let parts = found.parts.as_ref().expect("asked for");
    let own = &parts.sources["reference"]["camera"];
    assert_eq!((own.moments, own.apart_m.value, own.ahead_m.value), (6, 0.0, 0.0));
    assert!(own.parts.iter().all(|part| part.taken_away_m.value == 0.0 && part.alone_m.value == 0.0));
    let other = &parts.sources["sim-rgb"]["camera"];
    assert!(other.apart_m.value > 0.0 && other.apart_m.low <= other.apart_m.value, "{:?}", other.apart_m);
    assert!((other.parts.iter().map(|part| part.share.value).sum::<f64>() - 1.0).abs() < 1e-9);
    assert!(other.parts.windows(2).all(|pair| pair[0].taken_away_m.value >= pair[1].taken_away_m.value));
    let of = |name: &str| other.parts.iter().find(|part| part.part == name).expect("a part");
    let surface = of("road surface");
    assert!(surface.alone_m.value > 0.0 && surface.share.value > 0.05 && surface.taken_away_m.value != 0.0);
    assert!(other.parts.iter().all(|part| part.alone_m.value == 0.0 || part.share.value > 0.0));

    assert!(!parts.furthest.contains_key("reference"));
    let furthest = &parts.furthest["sim-rgb"];
    assert!(furthest.len() == 3 && furthest.windows(2).all(|pair| pair[0].apart_m >= pair[1].apart_m));
    study::write(&config, &found).expect("writes");
    let page = std::fs::read_to_string(folder.path().join("index.html")).expect("a page");
    for moment in furthest {
        let picture = std::fs::metadata(folder.path().join("scenes").join(&moment.picture)).expect("a picture");
        assert!(picture.len() > 0 && page.contains(&moment.picture), "{moment:?}");
    }
    assert!(page.contains("cones and barriers") && folder.path().join("parts.json").exists());

    let (again, second) = run(&config, 2).expect("the study runs");
    assert_eq!((second.made, second.kept), (0, 6));
    assert_eq!(again, found);
    let anew = tempfile::tempdir().expect("a temporary folder");
    let anew = StudyConfig { out: anew.path().to_path_buf(), ..config };
    assert!(run(&anew, 1).expect("the study runs").0 == found, "one thread and two");
}

#[test]
fn wrong_studies_of_parts_are_named() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let check = |change: fn(&mut StudyConfig), words: &str| {
        let mut config = config(folder.path());
        change(&mut config);
        let error = run(&config, 1).map(|_| ()).expect_err(words).to_string();
        assert!(error.contains(words), "{error}");
    };
    check(|config| config.sources.truncate(1), "sources: must name one besides the reference");
    check(|config| config.panel[0].control = true, "panel: must name a policy that is no control");
    check(|config| config.panel[0].policy = "lattice".to_owned(), "lattice");
    check(|config| config.every = 0, "every");
    check(|config| config.edits = vec![["sim-rgb", "reference"].map(str::to_owned)], "edits");
    // What distances are of lies further apart.
    let error = config(folder.path()).check_for(Study::Fidelity).expect_err("near").to_string();
    assert!(error.contains("every: must be 8"), "{error}");
}

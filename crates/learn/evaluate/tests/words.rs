//! Words count: a first frame from layout and prompt alone, drawn by the shipped weights, shows the night and the snow that they tell.

use std::collections::BTreeSet;
use std::path::Path;

use ds_camera::ReferenceWorld;
use ds_evaluate::evaluation::{Evaluation, Part};
use ds_evaluate::outcome::Outcome;
use ds_evaluate::{EvalConfig, Silent};

#[test]
fn first_frames_show_what_words_tell() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../configs/eval");
    let mut config = EvalConfig::load(&folder.join("first_frames.toml")).expect("the configuration is right");
    let out = tempfile::tempdir().expect("a folder");
    config.out = out.path().to_path_buf();
    config.resamples = 1;
    let wanted = config.first_frames.as_mut().expect("the part is there");
    wanted.scenarios = 1;
    wanted.wordings.retain(|condition, texts| {
        texts.truncate(1);
        ["night", "snow"].contains(&condition.as_str())
    });
    let mut outcome = Outcome::default();
    let mut silent = Silent;
    let mut evaluation = Evaluation::open(&config, &[&ReferenceWorld], &mut silent).expect("it opens");
    evaluation.measure(&mut outcome, &BTreeSet::from([Part::FirstFrames]), &|| 0.0).expect("it measures");
    let shown = &outcome.first_frames.expect("it was measured").conditions;
    let [night, snow] = ["night", "snow"].map(|name| &shown[name].words);
    let night = night.luma.expect("a figure").value;
    let snow = snow.ground.expect("a figure").value;
    assert!(night < 0.7, "night has {night} of the day's luma");
    assert!(snow > 1.3, "a road under snow has {snow} of the dry one's luma");
}

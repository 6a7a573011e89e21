//! The trainings learn, repeat themselves, go on where they stopped, and wrong recipes are refused.

use super::*;
use crate::overlap::Target;

const RECIPE: &str = "version = 2\nseed = 3\nwidth_px = 64\nheight_px = 32\nheld_out_scenarios = 1\nframes = 3\n\
    [segmenter]\nscenarios = 2\nsteps = 12\nbatch = 2\nlearning_rate = 0.004\nwarm_up = 2\n\
    [lights]\nscenarios = 1\nsteps = 10\nbatch = 4\nlearning_rate = 0.004\nwarm_up = 2\n\
    [look]\nscenarios = 2\nsteps = 12\nbatch = 4\nlearning_rate = 0.004\nwarm_up = 2\n";

#[derive(Default)]
struct Losses(Vec<f64>);

impl Progress for Losses {
    fn step(&mut self, _step: u32, _total: u32, loss: f64) {
        self.0.push(loss);
    }
    fn note(&mut self, _text: &str) {}
}

#[test]
fn training_lowers_the_loss_and_goes_on_where_it_stopped() {
    let recipe = Recipe::parse(RECIPE).expect("the recipe is right");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut losses = Losses::default();
    let trained = segmenter::train(&recipe, Some(folder.path()), &mut losses).expect("trains");
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    assert!(mean(&losses.0[9..]) < 0.9 * mean(&losses.0[..3]), "{:?}", losses.0);
    assert!(trained.sharp.iou(Target::Road).is_some_and(|iou| (0.0..=1.0).contains(&iou)));
    assert!(trained.file.metadata["command"].contains("--example train-perception -- segmenter"));
    let mut again = Losses::default();
    let resumed = segmenter::train(&recipe, Some(folder.path()), &mut again).expect("trains");
    assert!(again.0.is_empty(), "a finished training does no more steps");
    assert_eq!(resumed.file, trained.file);
    let other = Recipe { seed: 4, ..recipe };
    let error = segmenter::train(&other, Some(folder.path()), &mut Silent).err().expect("another recipe").to_string();
    assert!(error.contains("another recipe"), "{error}");
}

#[test]
fn lights_are_learned_from_crops() {
    let recipe = Recipe::parse(RECIPE).expect("the recipe is right");
    let trained = lights::train(&recipe, None, &mut Silent).expect("trains");
    let again = lights::train(&recipe, None, &mut Silent).expect("trains");
    assert_eq!(trained.file, again.file);
    assert!(trained.readings.iter().all(|reading| reading.distance_m > 0.0));
}

#[test]
fn looks_are_learned() {
    let recipe = Recipe::parse(RECIPE).expect("the recipe is right");
    let mut losses = Losses::default();
    let trained = look::train(&recipe, None, &mut losses).expect("trains");
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    assert!(mean(&losses.0[9..]) < mean(&losses.0[..3]), "{:?}", losses.0);
    assert!(trained.sharp.iter().chain(&trained.soft).all(|share| (0.0..=1.0 + 1e-9).contains(share)));
}

#[test]
fn the_shipped_recipe_is_accepted_and_wrong_ones_are_named() {
    Recipe::parse(include_str!("../../../../../configs/train/perception.toml")).expect("the recipe is right");
    let check = |from: &str, to: &str, expected: &str| {
        let error = Recipe::parse(&RECIPE.replacen(from, to, 1)).expect_err("the value is wrong");
        let text = format!("{error} {:?}", std::error::Error::source(&error).map(ToString::to_string));
        assert!(text.contains(expected), "{text}");
    };
    check("version = 2", "version = 1", "version");
    check("width_px = 64", "width_px = 63", "width_px");
    check("frames = 3", "frames = 0", "frames");
    check("learning_rate = 0.004", "learning_rate = nan", "segmenter");
    check("seed = 3", "sed = 3", "sed");
}

#[test]
fn cross_entropy_is_worked_out_by_hand() {
    // Equal scores cost ln 3; the true class is short by 2/3 of its share.
    let (loss, gradient) = mean_cross_entropy(&Array::zeros(&[2, 3]), &[0, 2]);
    assert!((loss - 3f64.ln()).abs() < 1e-6);
    for (index, value) in [(0, -1.0 / 3.0), (1, 1.0 / 6.0), (5, -1.0 / 3.0)] {
        assert!((gradient.values()[index] - value).abs() < 1e-6, "{index}: {}", gradient.values()[index]);
    }
}

#[test]
fn mirroring_keeps_colours_in_order() {
    let mut row = [1, 2, 3, 4, 5, 6];
    mirror(&mut row, 6, 3);
    assert_eq!(row, [4, 5, 6, 1, 2, 3]);
}

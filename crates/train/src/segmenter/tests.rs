//! The segmenter learns, repeats itself and refuses wrong settings.

use super::*;
use crate::Silent;
use overlap::Target;

const SETTINGS: &str = "version = 1\nseed = 3\nwidth_px = 64\nheight_px = 32\nscenarios = 2\nheld_out_scenarios = 1\n\
    frames = 3\nsteps = 12\nbatch = 2\nlearning_rate = 0.004\nwarm_up = 2\n";

#[derive(Default)]
struct Losses(Vec<f32>);

impl Progress for Losses {
    fn step(&mut self, _step: u32, _total: u32, loss: f32, _figures: &[(&str, f32)]) {
        self.0.push(loss);
    }
    fn note(&mut self, _text: &str) {}
}

#[test]
fn training_lowers_the_loss_and_repeats_itself() {
    let settings = SegmenterSettings::parse(SETTINGS).expect("the settings are right");
    let mut losses = Losses::default();
    let trained = train(&settings, &mut losses).expect("trains");
    let mean = |part: &[f32]| part.iter().sum::<f32>() / part.len() as f32;
    assert!(mean(&losses.0[9..]) < 0.9 * mean(&losses.0[..3]), "{:?}", losses.0);
    assert_eq!(train(&settings, &mut Silent).expect("trains").file, trained.file);
    assert!(trained.sharp.iou(Target::Road).is_some_and(|iou| (0.0..=1.0).contains(&iou)));
    assert!(trained.file.metadata["command"].contains("train-segmenter"));
}

#[test]
fn the_shipped_recipe_is_accepted_and_wrong_ones_are_named() {
    SegmenterSettings::parse(include_str!("../../../../configs/train/segmenter.toml")).expect("the recipe is right");
    let check = |from: &str, to: &str, expected: &str| {
        let error = SegmenterSettings::parse(&SETTINGS.replace(from, to)).expect_err("the value is wrong");
        let text = format!("{error} {:?}", std::error::Error::source(&error).map(ToString::to_string));
        assert!(text.contains(expected), "{text}");
    };
    check("version = 1", "version = 2", "version");
    check("width_px = 64", "width_px = 63", "width_px");
    check("frames = 3", "frames = 0", "frames");
    check("learning_rate = 0.004", "learning_rate = nan", "learning_rate");
    check("seed = 3", "sed = 3", "sed");
}

#[test]
fn cross_entropy_is_worked_out_by_hand() {
    // Two pixels, equal scores: each costs ln 6 whatever its weight.
    let (loss, gradient) = cross_entropy(&Array::zeros(&[1, 1, 2, 6]), &[0, 3]);
    assert!((loss - 6f64.ln()).abs() < 1e-6);
    // Weights 1 and 4 of 5: the true class is short by 5/6 of its share, the others have 1/6 of it too much.
    let expected = [(0, -1.0 / 6.0), (1, 1.0 / 30.0), (6, 4.0 / 30.0), (9, -4.0 / 6.0)];
    for (index, value) in expected {
        assert!((gradient.values()[index] - value).abs() < 1e-6, "{index}: {}", gradient.values()[index]);
    }
}

#[test]
fn mirroring_keeps_colours_in_order_and_equal_scores_give_the_first_class() {
    let mut row = [1, 2, 3, 4, 5, 6];
    mirror(&mut row, 6, 3);
    assert_eq!(row, [4, 5, 6, 1, 2, 3]);
    assert_eq!(best(&[0.0, 2.0, 2.0, 1.0, 0.0, 0.0]), PixelClass::Paint);
}

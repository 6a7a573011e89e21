//! The whole measurement in miniature, with untrained weights, and its arithmetic by hand.

use super::*;
use crate::Silent;
use crate::segmenter::CLASSES;
use report::{as_json, as_markdown, bootstrap, contrast, ratio};

const SPAN: Span = Span { scenarios: 2, first_tick: 4, last_tick: 9 };

fn miniature() -> (Models, Segmenter) {
    let config =
        ModelConfig::parse(include_str!("../../../../configs/models/smoke.toml")).expect("the preset is right");
    let weights = Weights::initialised(&VideoModel::declare(&config), &Digest::of(b"video"));
    let segmenter = Weights::initialised(&ds_nn::segmenter::declare(CLASSES.len()), &Digest::of(b"segmenter"));
    let models = Models::new(&config, &weights).expect("the weights fit");
    (models, Segmenter::new(&segmenter).expect("the weights fit"))
}

#[test]
fn a_measurement_repeats_itself_and_fills_its_folder() {
    let (models, segmenter) = miniature();
    let measured = measure(&models, &segmenter, SPAN, &mut Silent).expect("measures");
    assert_eq!(measured.drives.len(), 2);
    assert_ne!(measured.drives[0].family, measured.drives[1].family, "the families take turns");
    for drive in &measured.drives {
        let pixels = 64 * 32 * 3 * u64::from(SPAN.last_tick - SPAN.first_tick + 1);
        assert_eq!(drive.inside.values + drive.outside.values, pixels);
        for overlaps in [drive.reference, drive.with_layout, drive.without_layout] {
            assert!(Target::ALL.iter().all(|t| overlaps.iou(*t).is_none_or(|iou| (0.0..=1.0).contains(&iou))));
        }
    }
    assert_eq!(measured.sheet.len(), 10);
    assert!(measured.sheet.iter().all(|row| row.len() == 6));
    let folder = tempfile::tempdir().expect("a temporary folder");
    report::write(&measured, folder.path()).expect("writes");
    let text = std::fs::read_to_string(folder.path().join("layout-following.json")).expect("the report is there");
    let json: serde_json::Value = serde_json::from_str(&text).expect("the report is JSON");
    assert_eq!(json["weights_digest"], models.weights_digest.to_string());
    assert_eq!(json["drives"].as_array().map(Vec::len), Some(2));
    assert!(folder.path().join("layout-following.png").exists());
    assert!(as_markdown(&measured).contains("| lane_paint |"));
    let again = measure(&models, &segmenter, SPAN, &mut Silent).expect("measures");
    assert_eq!(again, measured);
}

#[test]
fn switching_the_layout_off_makes_layouts_irrelevant() {
    let (models, _) = miniature();
    let drive = Drive::held_out(1, (64, 32), 4).expect("renders");
    let black = vec![RgbImage::filled(64, 32, [0; 3]); 5];
    let off = |layouts| roll(&models.without_layout, &drive, layouts).expect("rolls out");
    assert_eq!(off(&drive.layouts), off(&black));
    let on = |layouts| roll(&models.with_layout, &drive, layouts).expect("rolls out");
    assert_ne!(on(&drive.layouts), on(&black));
}

#[test]
fn spans_without_ticks_are_refused() {
    let (models, segmenter) = miniature();
    for span in [Span { scenarios: 0, ..SPAN }, Span { first_tick: 0, ..SPAN }, Span { first_tick: 10, ..SPAN }] {
        let error = measure(&models, &segmenter, span, &mut Silent).expect_err("the span is wrong");
        assert!(error.to_string().contains("span"), "{error}");
    }
}

/// A drive that finds `with` of 4 vehicle pixels with layouts and `without` of 4 without, and changes as given.
fn drive(with: usize, without: usize, inside: Difference, outside: Difference) -> DriveMeasured {
    let found = |count: usize| {
        let mut overlaps = Overlaps::default();
        let map: Vec<_> = (0..4).map(|i| if i < count { PixelClass::Vehicle } else { PixelClass::Road }).collect();
        overlaps.add(&[PixelClass::Vehicle; 4], &map);
        overlaps
    };
    let (reference, with_layout, without_layout) = (found(4), found(with), found(without));
    DriveMeasured { family: "test", seed: 0, reference, with_layout, without_layout, inside, outside }
}

#[test]
fn ratios_are_pooled_over_drives_and_bracketed_by_resamples() {
    let change = |sum| Difference { sum, values: 10 };
    let drives = [drive(4, 1, change(90), change(10)), drive(2, 1, change(30), change(20))];
    let found = ratio(&drives, Target::Vehicle).expect("both arms saw vehicles");
    assert!((found.value - 3.0).abs() < 1e-12, "(4 + 2) over (1 + 1): {found:?}");
    assert_eq!((found.low, found.high), (2.0, 4.0), "resamples hold 2, 3 or 4");
    let found = contrast(&drives).expect("both places have pixels");
    assert!((found.value - 4.0).abs() < 1e-12, "120 over 30: {found:?}");
    assert_eq!((found.low, found.high), (1.5, 9.0));
    assert_eq!(ratio(&drives, Target::LanePaint), None, "nobody saw paint");
    let never = [drive(4, 0, change(1), change(0))];
    assert_eq!(ratio(&never, Target::Vehicle).map(|e| e.value), Some(f64::INFINITY));
    assert_eq!(bootstrap(&never, |_| None), None);
}

#[test]
fn differences_are_split_by_the_true_class() {
    let a = RgbImage::new(2, 1, vec![10, 20, 30, 5, 5, 5]).expect("the size fits");
    let b = RgbImage::new(2, 1, vec![13, 18, 30, 5, 6, 5]).expect("the size fits");
    let (mut inside, mut outside) = (Difference::default(), Difference::default());
    differ(&[PixelClass::Person, PixelClass::Road], &a, &b, (&mut inside, &mut outside));
    assert_eq!((inside.mean(), outside.mean()), (Some(5.0 / 3.0), Some(1.0 / 3.0)));
    let (weights_digest, decoder_guided) = (Digest::of(b""), false);
    let json = as_json(&Measured { span: SPAN, weights_digest, decoder_guided, drives: vec![], sheet: vec![] });
    assert!(json["change_without_agents"]["inside"].is_null(), "{json}");
}

//! The page shows every part, escapes names and is well formed where nothing was measured.

use super::*;
use crate::estimate::Estimate;
use crate::outcome::{ArmNote, ColumnDrift, DriftOutcome, LayoutOutcome};

fn estimate(value: f64) -> Option<Estimate> {
    Some(Estimate { value, low: value - 1.0, high: value + 1.0, samples: 16 })
}

fn config() -> EvalConfig {
    EvalConfig::parse(
        "version = 1\nout = \"out\"\n[perception]\nsegmenter = \"s\"\nlights = \"l\"\nlook = \"k\"\n[arms]\n[columns]\n\
         first_seed = 1\nscenarios = 1\nlook = \"day\"\n",
        std::path::Path::new("."),
    )
    .expect("the configuration is right")
}

#[test]
fn an_empty_outcome_is_a_page() {
    let page = html(&Outcome::default(), &config());
    assert!(page.starts_with("<!DOCTYPE html>") && page.ends_with("</html>\n"), "{page}");
    assert!(!page.contains("Drift"));
    assert!(page.contains("Content-Security-Policy") && !page.contains("<script"));
}

#[test]
fn figures_and_plots_are_shown_and_names_escaped() {
    let mut outcome = Outcome { quick: true, ..Outcome::default() };
    outcome.arms.insert("<b>".to_owned(), ArmNote::default());
    let mut layout = LayoutOutcome::default();
    let mut column = ColumnLayout::default();
    column.reference.iou.insert("lane".to_owned(), estimate(0.5));
    column.arms.insert("student".to_owned(), ArmLayout { error: estimate(0.25), ..ArmLayout::default() });
    layout.columns.insert("A".to_owned(), column);
    outcome.layout = Some(layout);
    let mut drift = DriftOutcome::default();
    let curve = vec![(50, estimate(2.0)), (100, None), (200, estimate(7.5))];
    let arm = ArmDrift { curve, rise: estimate(5.5), ..ArmDrift::default() };
    let column = ColumnDrift { arms: BTreeMap::from([("early".to_owned(), arm)]), ..ColumnDrift::default() };
    drift.columns.insert("A".to_owned(), column);
    outcome.drift = Some(drift);
    let page = html(&outcome, &config());
    for part in [
        "A quick look",
        "&lt;b&gt;",
        "0.250 (-0.750\u{a0}to\u{a0}1.250)",
        "<svg",
        "polyline",
        "5.50 (4.50\u{a0}to\u{a0}6.50)",
    ] {
        assert!(page.contains(part), "{part} is missing");
    }
    assert!(!page.contains("<b>"));
}

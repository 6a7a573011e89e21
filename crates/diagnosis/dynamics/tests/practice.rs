//! The labelled practice cases: verdict kinds and first effects, with stated minimum figures.

use std::path::PathBuf;

use ds_diagnosis::score::{read_labels, score};
use ds_dynamics::case::Case;
use ds_dynamics::{Options, diagnose};
use rayon::prelude::*;

/// Verdicts that must be right, of twelve.
const VERDICTS: usize = 12;
/// Single effects that must come first, of eight.
const FIRST: usize = 8;

#[test]
fn practice_cases_reach_their_minimum() {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../../shared/data/gap-practice");
    if !folder.join("labels.json").exists() {
        eprintln!("skipped: the practice cases are not at {}", folder.display());
        return;
    }
    let labels = read_labels(&folder.join("labels.json")).expect("labels");
    let names: Vec<&String> = labels.keys().collect();
    let found = names
        .par_iter()
        .map(|name| {
            let options = Options { quick: true, ..Options::default() };
            ((*name).clone(), diagnose(&Case::read(&folder.join(name)).expect("a case"), &options))
        })
        .collect();
    let scores = score(&found, &labels);
    let hits = |name: &str| scores.shares.get(name).copied().flatten().map_or(0, |s| s.hits);
    assert!(hits("verdict") >= VERDICTS, "{:#?}", scores.shares);
    assert!(hits("singles: first") >= FIRST, "{:#?}", scores.shares);
    assert_eq!(hits("false alarms"), 0);
}

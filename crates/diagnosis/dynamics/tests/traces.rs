//! Residuals over time: with a neutral model nothing changes, with the true effect the gap closes.

use std::path::PathBuf;

use ds_diagnosis::schema::{Corrected, CorrectedEffect};
use ds_dynamics::case::Case;
use ds_dynamics::traces::{POSITION, traces};

fn case() -> Option<Case> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../../shared/data/gap-practice/case_04");
    if !folder.join("meta.json").exists() {
        eprintln!("skipped: no case at {}", folder.display());
        return None;
    }
    Some(Case::read(&folder).expect("a case"))
}

#[test]
fn a_neutral_model_changes_nothing() {
    let Some(case) = case() else { return };
    let found = traces(&case, &Corrected::default(), 3);
    assert!(found.held_out && found.file == "drive_3.csv");
    assert_eq!(found.series[0].name, POSITION);
    assert_eq!(found.series.len(), 12, "position, nine channels, two of the followers");
    for series in &found.series {
        assert!(series.moments.windows(2).all(|pair| pair[0].secs < pair[1].secs), "{} is in order", series.name);
        assert!(series.moments.iter().all(|m| m.before.to_bits() == m.after.to_bits()), "{}", series.name);
    }
    assert!(found.path.len() > 100 && found.path.windows(2).all(|pair| pair[0][0] < pair[1][0]));
    assert!(traces(&case, &Corrected::default(), 9).series.is_empty(), "there is no such drive");
}

#[test]
fn the_true_effect_closes_the_gap() {
    let Some(case) = case() else { return };
    // the label of this case: 0.15 s of steering delay, on top of which every vehicle has some
    let effect = CorrectedEffect { id: "steer_delay".to_owned(), value: 0.15, values: vec![0.16] };
    let model = Corrected { effects: vec![effect], ..Corrected::default() };
    let found = traces(&case, &model, 3);
    let [before, after, floor] = found.series[0].roots();
    assert!(before > 5.0 * floor && after < 0.4 * before, "{before} {after} {floor}");
}

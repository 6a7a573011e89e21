//! The age of what a policy sees, read off the stamps of its answers and of the frames behind them: `obs_latency`.
//!
//! The nominal bridge shows the newest frame. Stamps have no noise, so that the median age is the estimate, known to half
//! the distance of two frames; nothing else in a log shows this effect, and it takes no other effect's place.

use std::fmt::Write as _;
use std::path::Path;

use ds_diagnosis::schema::{Cell, Corrected, CorrectedEffect, Finding, Regime};
use ds_diagnosis::table::Table;
use ds_diagnosis::{Diagnosis, Verdict};
use ds_record::vehicle_log::Planned;

use crate::error::{CasesError, at};

const ID: &str = "obs_latency";
const ENDING: &str = ".plans.csv";
/// Ages below this are the nominal bridge's own, s.
const USUAL_SECS: f64 = 0.02;
/// At least so many answers are needed.
const FEWEST: usize = 5;
/// How sure stamps make, and what stays for everything else.
const SURE: f64 = 0.99;

/// Writes the stamps of a drive's answers beside its table; nothing where the bridge said none.
///
/// # Errors
/// If the file cannot be written.
pub fn write(plans: &[Planned], case: &Path, drive: &str) -> Result<(), CasesError> {
    if plans.is_empty() {
        return Ok(());
    }
    let mut text = String::from("t,frame_t\n");
    for planned in plans {
        let _infallible = writeln!(text, "{},{}", planned.t, planned.frame_t);
    }
    let path = case.join(format!("{drive}{ENDING}"));
    std::fs::write(&path, text).map_err(at(&path))
}

/// Reads the stamps of all drives of a case folder.
///
/// # Errors
/// If a file cannot be read or is no such table.
pub fn read(case: &Path) -> Result<Vec<Planned>, CasesError> {
    let mut plans = Vec::new();
    let entries = std::fs::read_dir(case).map_err(at(case))?;
    for path in entries.flatten().map(|entry| entry.path()).filter(|path| path.to_string_lossy().ends_with(ENDING)) {
        let table = Table::read(&path)?;
        let pairs = table.required("t")?.iter().zip(table.required("frame_t")?);
        plans.extend(pairs.map(|(t, frame_t)| Planned { t: *t, frame_t: *frame_t }));
    }
    Ok(plans)
}

/// Diagnoses the stamps of a case.
#[must_use]
pub fn diagnose(case: &str, plans: &[Planned]) -> Diagnosis {
    let mut ages: Vec<f64> = plans.iter().map(|plan| plan.t - plan.frame_t).filter(|age| age.is_finite()).collect();
    ages.sort_by(f64::total_cmp);
    let age = |share: f64| ages.get((share * (ages.len().max(1) - 1) as f64) as usize).copied();
    let blank = Diagnosis::blank(case);
    let (Some(low), Some(secs), Some(high)) = (age(0.05), age(0.5), age(0.95)) else { return blank };
    if ages.len() < FEWEST || secs < USUAL_SECS {
        return blank;
    }
    let last = plans.iter().map(|plan| plan.t).fold(0.0, f64::max);
    let finding = Finding {
        id: ID.to_owned(),
        probability: SURE,
        value: secs,
        unit: "s".to_owned(),
        interval90: [low, high],
        group: vec![ID.to_owned()],
        heldout_gain: None,
        evidence_gain: 0.0,
        params: std::iter::once((ID.to_owned(), secs)).collect(),
    };
    Diagnosis {
        verdict: Verdict::Single,
        effects: vec![finding],
        p_none: 1.0 - SURE,
        chosen: vec![ID.to_owned()],
        cells: vec![Cell {
            channel: "observation age".to_owned(),
            regime: Regime::default(),
            effect_size: secs / USUAL_SECS,
            q_value: None,
            t: vec![[0.0, last]],
        }],
        corrected_model: Corrected {
            effects: vec![CorrectedEffect { id: ID.to_owned(), value: secs, values: vec![secs] }],
            ..Corrected::default()
        },
        ..blank
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plans(age_secs: f64, count: u32) -> Vec<Planned> {
        (0..count).map(|k| Planned { t: f64::from(k), frame_t: f64::from(k) - age_secs }).collect()
    }

    #[test]
    fn old_frames_are_found_and_fresh_or_few_ones_not() {
        let found = diagnose("late", &plans(0.25, 20));
        assert_eq!((found.verdict, found.chosen.as_slice()), (Verdict::Single, [ID.to_owned()].as_slice()));
        assert!((found.effects[0].value - 0.25).abs() < 1e-9 && found.cells.len() == 1);
        for blank in [diagnose("fresh", &plans(0.01, 20)), diagnose("few", &plans(0.25, 4)), diagnose("none", &[])] {
            assert!(blank.verdict == Verdict::None && blank.effects.is_empty(), "{}", blank.case);
        }
    }

    #[test]
    fn beside_nothing_they_are_nearly_sure_and_beside_another_effect_both_are_true() {
        let late = diagnose("late", &plans(0.25, 20));
        let mut alone = Diagnosis::blank("late");
        alone.join(late.clone());
        assert_eq!((alone.verdict, alone.effects[0].probability), (Verdict::Single, SURE));
        assert!((alone.p_none + alone.p_unknown + SURE - 1.0).abs() < 1e-12);
        let mut beside = Diagnosis { verdict: Verdict::Single, p_none: 0.1, ..Diagnosis::blank("late") };
        beside.effects = vec![Finding { id: "mu".to_owned(), probability: 0.9, ..late.effects[0].clone() }];
        beside.chosen = vec!["mu".to_owned()];
        beside.join(late);
        assert_eq!((beside.verdict, beside.chosen.len()), (Verdict::Multiple, 2));
        let listed: Vec<(&str, f64)> = beside.effects.iter().map(|e| (e.id.as_str(), e.probability)).collect();
        assert_eq!(listed, [("mu", 0.45), (ID, 0.5)]);
    }

    #[test]
    fn what_was_written_is_read() {
        let folder = tempfile::tempdir().expect("a folder");
        write(&plans(0.1, 3), folder.path(), "a").expect("it can be written");
        write(&[], folder.path(), "b").expect("nothing is written");
        assert_eq!(read(folder.path()).expect("it can be read"), plans(0.1, 3));
    }
}

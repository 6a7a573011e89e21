//! Effects injected into the crate's own simulator, with sensor noise, are found and measured; nothing is found where
//! nothing was injected.

use std::path::Path;
use std::sync::LazyLock;

use ds_diagnosis::meta::DriveEntry;
use ds_diagnosis::{Diagnosis, Verdict};
use ds_dynamics::case::Case;
use ds_dynamics::{Options, diagnose, synthetic};
use ds_effect::find;

fn diagnosed(seed: u64, injected: &[(&str, f64)], options: &Options) -> Diagnosis {
    let folder = tempfile::tempdir().expect("a folder");
    let edit = |plant: &mut ds_effect::Plant| {
        for (id, value) in injected {
            let effect = find(id).expect("the effect is in the library");
            let mut values = effect.neutral();
            values[0] = *value;
            (effect.apply)(&values, plant);
        }
    };
    synthetic::write_case(folder.path(), seed, &edit).expect("the case can be written");
    diagnose(&read(folder.path()), options)
}

fn read(folder: &Path) -> Case {
    Case::read(folder).expect("the case can be read")
}

fn quick() -> Options {
    Options { quick: true, ..Options::default() }
}

/// The effect of [`LATE`].
pub(crate) const DELAY: (u64, &[(&str, f64)]) = (42, &[("steer_delay", 0.12)]);
/// A quick diagnosis that several tests look at.
pub(crate) static LATE: LazyLock<Diagnosis> = LazyLock::new(|| diagnosed(DELAY.0, DELAY.1, &quick()));

#[test]
fn single_effects_are_found_and_measured() {
    // id, injected value, tolerance of the estimate
    let rows =
        [("steer_delay", 0.12, 0.02), ("steer_rate", 0.12, 0.02), ("drag_add", 1.2, 0.15), ("lever_arm", 1.5, 0.2)];
    for (id, value, tolerance) in rows {
        let found = diagnosed(11, &[(id, value)], &quick());
        assert_eq!(found.chosen, [id], "{id}: {:?}", found.verdict);
        let first = &found.effects[0];
        assert!((first.value - value).abs() < tolerance, "{id}: {} instead of {value}", first.value);
    }
}

#[test]
fn nothing_is_found_where_nothing_is_missing() {
    let found = diagnosed(21, &[], &quick());
    assert_eq!(found.verdict, Verdict::None, "{:?}", found.chosen);
    let sum: f64 = found.effects.iter().map(|e| e.probability).sum::<f64>() + found.p_none + found.p_unknown;
    assert!((sum - 1.0).abs() < 1e-9, "{sum}");
}

#[test]
fn an_effect_that_begins_within_a_drive_is_dated() {
    let folder = tempfile::tempdir().expect("a folder");
    synthetic::write_case(folder.path(), 41, &|_| {}).expect("the case can be written");
    let healthy = read(folder.path());
    let (meta, mut drives) = (healthy.meta.clone(), healthy.drives.clone());
    let begins = 15.0;
    for (number, drive) in drives.iter_mut().enumerate() {
        let (start, rate) = (drive.start_secs, drive.rate_hz);
        let late = |k: usize| number > 0 || start + k as f64 / rate >= begins;
        let column = drive.yaw_rate.iter_mut().flatten().enumerate();
        column.filter(|(k, _)| late(*k)).for_each(|(_, value)| *value += 0.02);
    }
    let found = diagnose(&Case::new(meta, drives).expect("the case is sound"), &quick());
    assert_eq!(found.chosen, ["gyro_bias"], "{:?}", found.verdict);
    let course = found.modulation.expect("something was accepted");
    assert_eq!((course.kind.as_str(), course.drive), ("onset", Some(0)), "{course:?}");
    let onset = course.onset_s.expect("it has an instant");
    assert!((onset - begins).abs() < 2.0, "{course:?}");
    assert!((course.value.expect("it has a size") - 0.02).abs() < 0.003, "{course:?}");
    assert_eq!(found.verdict, Verdict::Single, "what begins is not unknown for that");
}

#[test]
fn constant_effects_are_called_constant() {
    assert_eq!(LATE.modulation.as_ref().expect("something was accepted").kind, "constant");
}

#[test]
fn two_effects_in_one_drive_are_both_found() {
    let found = diagnosed(31, &[("steer_delay", 0.12), ("drag_add", 1.2)], &Options::default());
    let mut chosen = found.chosen.clone();
    chosen.sort();
    assert_eq!(chosen, ["drag_add", "steer_delay"], "{:?}", found.verdict);
    assert_eq!(found.verdict, Verdict::Multiple);
}

#[test]
fn an_effect_that_the_library_lacks_is_called_unknown() {
    let options = Options { quick: true, without: vec!["steer_offset".to_owned(), "gyro_bias".to_owned()] };
    let found = diagnosed(41, &[("steer_offset", 0.015)], &options);
    assert_eq!(found.verdict, Verdict::Unknown, "{:?}", found.chosen);
    assert!(found.unknown_description.is_some());
}

#[test]
fn a_frozen_diagnosis_shrinks_the_gap_of_an_unseen_case_of_the_same_vehicle() {
    let folder = tempfile::tempdir().expect("a folder");
    let edit = |plant: &mut ds_effect::Plant| plant.vehicle.drag_n_s2_m2 += 0.6;
    synthetic::write_case(folder.path(), 51, &edit).expect("the case can be written");
    let found = diagnose(&read(folder.path()), &quick());
    let other = tempfile::tempdir().expect("a folder");
    synthetic::write_case(other.path(), 52, &edit).expect("the case can be written");
    let shrink = ds_dynamics::evaluate(&found, &read(other.path()), &[1]);
    let position = shrink.iter().find(|s| s.metric == "position_2s").expect("the metric is there");
    assert!(position.share_explained.is_some_and(|share| share > 0.8), "{position:?}");
    assert_eq!(position.data, "unseen");
    let few = position.saved.as_ref().expect("an effect was added");
    assert!(few.drives == 1 && few.interval90.is_none(), "{few:?}");
    assert!(few.note.as_ref().is_some_and(|note| note.contains("too few for an interval")), "{few:?}");
    assert!((few.value - (position.nuisance.expect("a state") - position.after)).abs() < 1e-12, "{position:?}");
    // with the drives of the fit's case there are eight
    let mut both = read(other.path());
    for (k, drive) in read(folder.path()).drives.into_iter().enumerate() {
        let entry = DriveEntry { file: format!("more_{k}.csv"), ..DriveEntry::default() };
        both = both.joined(entry, drive).expect("a further drive of the same car");
    }
    let shrink = ds_dynamics::evaluate(&found, &both, &[]);
    let position = shrink.iter().find(|s| s.metric == "position_2s").expect("the metric is there");
    let many = position.saved.as_ref().expect("an effect was added");
    let [low, high] = many.interval90.expect("eight drives");
    assert!(many.drives == 8 && many.note.is_none() && 0.0 < low && low < many.value && many.value < high, "{many:?}");
}

/// Rewrites the logs of a case as those of a car whose steering gives way in corners: the servo turned as logged, the
/// wheels by less the harder the corner.
fn give_way(folder: &Path, share: f64) {
    for drive in 0..4 {
        let path = folder.join(format!("drive_{drive}.csv"));
        let text = std::fs::read_to_string(&path).expect("the drive can be read");
        let mut lines = text.lines();
        let head: Vec<&str> = lines.next().expect("a head").split(',').collect();
        let place = |name: &str| head.iter().position(|column| *column == name).expect("the column is there");
        let steering = [place("cmd_steer"), place("steer_meas")];
        let mut out = head.join(",");
        for line in lines {
            let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
            let number = |cell: &String| cell.parse::<f64>().expect("a number");
            let corner = (number(&cells[place("v")]) * number(&cells[place("yaw_rate")])).abs();
            for k in steering {
                cells[k] = format!("{:.5}", number(&cells[k]) / (1.0 - share * corner));
            }
            out.push('\n');
            out.push_str(&cells.join(","));
        }
        std::fs::write(&path, out + "\n").expect("the drive can be written");
    }
}

#[test]
fn an_effect_whose_size_goes_with_the_regime_is_called_unknown() {
    let folder = tempfile::tempdir().expect("a folder");
    synthetic::write_case(folder.path(), 61, &|_| {}).expect("the case can be written");
    give_way(folder.path(), 0.06);
    let found = diagnose(&read(folder.path()), &quick());
    assert_eq!(found.verdict, Verdict::Unknown, "{:?}", found.chosen);
}

//! Logs of 200 rows a second are diagnosed as those of 20 that they were made of, whether their channels come that often or
//! stay until the next sample of their own, and what is odd about their stamps is said.

use std::path::Path;

use crate::recovery::{DELAY, LATE};
use ds_diagnosis::Diagnosis;
use ds_dynamics::case::Case;
use ds_dynamics::{Options, diagnose, synthetic};

/// Rows that become of one.
const ROWS: usize = 10;
/// Columns of the commands, after the stamp.
const COMMANDS: std::ops::RangeInclusive<usize> = 1..=2;

/// Makes ten rows of each of a drive: between two samples lines, or for measurements the sample before where they are held.
fn fast(text: &str, held: bool) -> String {
    let mut lines = text.lines();
    let head = lines.next().expect("a head line");
    let rows: Vec<Vec<f64>> =
        lines.map(|line| line.split(',').map(|cell| cell.parse().expect("a number")).collect()).collect();
    let between = |pair: &[Vec<f64>], k: usize| -> String {
        let u = k as f64 / ROWS as f64;
        let cell = |c: usize| {
            let moves = c == 0 || COMMANDS.contains(&c) || !held;
            pair[0][c] + if moves { u * (pair[1][c] - pair[0][c]) } else { 0.0 }
        };
        (0..pair[0].len()).map(|c| format!("{:.6}", cell(c))).collect::<Vec<_>>().join(",")
    };
    let made = rows.windows(2).flat_map(|pair| (0..ROWS).map(move |k| between(pair, k)));
    std::iter::once(head.to_owned()).chain(made).map(|line| line + "\n").collect()
}

fn edit(folder: &Path, to: impl Fn(&str) -> String) {
    for drive in 0..4 {
        let path = folder.join(format!("drive_{drive}.csv"));
        let text = std::fs::read_to_string(&path).expect("the drive can be read");
        std::fs::write(&path, to(&text)).expect("the drive can be written");
    }
}

fn diagnosed(seed: u64, injected: &[(&str, f64)], to: impl Fn(&str) -> String) -> Diagnosis {
    let folder = tempfile::tempdir().expect("a folder");
    let inject = |plant: &mut ds_effect::Plant| {
        for (id, value) in injected {
            (ds_effect::find(id).expect("the effect is in the library").apply)(&[*value], plant);
        }
    };
    synthetic::write_case(folder.path(), seed, &inject).expect("the case can be written");
    edit(folder.path(), to);
    let case = Case::read(folder.path()).expect("the case can be read");
    diagnose(&case, &Options { quick: true, ..Options::default() })
}

#[test]
fn two_hundred_rows_a_second_keep_verdict_and_effect() {
    const BIAS: (u64, &[(&str, f64)]) = (44, &[("gyro_bias", 0.012)]);
    let slow = |(seed, injected): (u64, &[(&str, f64)])| diagnosed(seed, injected, str::to_owned);
    let rows = [(DELAY, &*LATE), ((43, &[][..]), &slow((43, &[]))), (BIAS, &slow(BIAS))];
    for ((seed, injected), slow) in rows {
        for held in [false, true] {
            let found = diagnosed(seed, injected, |text| fast(text, held));
            let left = found.unknown_description.as_ref();
            assert_eq!((&found.verdict, &found.chosen), (&slow.verdict, &slow.chosen), "held: {held}, {left:?}");
            let said = found.warnings.join("; ");
            assert!(said.contains("200 samples a second") && !said.contains("scatter"), "{said}");
            let sizes = |d: &Diagnosis| d.effects.iter().find(|e| d.chosen.contains(&e.id)).map(|e| e.value);
            if let Some((found, slow)) = sizes(&found).zip(sizes(slow)) {
                assert!((found - slow).abs() < 0.05 * slow.abs(), "{found} beside {slow}, held: {held}");
            }
        }
    }
}

#[test]
fn lost_rows_of_a_fast_log_are_named_and_repeated_stamps_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    synthetic::write_case(folder.path(), 42, &|_| {}).expect("the case can be written");
    edit(folder.path(), |text| {
        let rows = fast(text, false);
        rows.lines().enumerate().filter(|(k, _)| !(800..860).contains(k)).map(|(_, row)| format!("{row}\n")).collect()
    });
    let said = Case::read(folder.path()).expect("a short gap is bridged").warnings.join("; ");
    assert!(said.contains("gaps in the stamps, 1 in all") && said.contains("0.305 s at most"), "{said}");
    edit(folder.path(), |text| {
        let rows: Vec<&str> = text.lines().collect();
        let twice = |(k, row): (usize, &&str)| if k == 500 { format!("{row}\n{row}\n") } else { format!("{row}\n") };
        rows.iter().enumerate().map(twice).collect()
    });
    let refused = Case::read(folder.path()).err().expect("a stamp twice").to_string();
    assert!(refused.contains("501"), "{refused}");
}

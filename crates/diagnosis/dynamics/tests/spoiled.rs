//! Spoiled logs: each gives a named error or a verdict with a warning, never a panic, never a confident wrong answer.

use std::fs;
use std::path::Path;

use ds_diagnosis::{CaseError, Diagnosis, Verdict};
use ds_dynamics::case::Case;
use ds_dynamics::space::Part;
use ds_dynamics::{Options, diagnose, synthetic};
use ds_effect::library;

use crate::rows::{change, changed};

type Edit = fn(&mut Vec<Vec<String>>);

/// Rewrites one column of a drive.
fn column(rows: &mut [Vec<String>], name: &str, edit: impl Fn(usize, f64) -> String) {
    let at = rows[0].iter().position(|c| c == name).expect("the column is there");
    for (k, row) in rows.iter_mut().enumerate().skip(1) {
        row[at] = edit(k, row[at].parse().expect("a number"));
    }
}

fn swap(rows: &mut [Vec<String>], a: &str, b: &str) {
    let (a, b) = (place(rows, a), place(rows, b));
    rows.iter_mut().skip(1).for_each(|row| row.swap(a, b));
}

fn place(rows: &[Vec<String>], name: &str) -> usize {
    rows[0].iter().position(|c| c == name).expect("the column is there")
}

const EDITS: &[(&str, &str, Edit)] = &[
    ("not a number", "NotANumber", |rows| rows[40][5] = "NaN".to_owned()),
    ("infinite", "NotANumber", |rows| rows[40][6] = "inf".to_owned()),
    ("text", "NotANumber", |rows| rows[40][7] = "fast".to_owned()),
    ("ragged row", "RaggedRow", |rows| {
        rows[12].pop();
    }),
    ("steering in degrees", "Inconsistent", |rows| {
        column(rows, "cmd_steer", |_, v| format!("{:.4}", v.to_degrees()));
    }),
    ("heading in degrees", "Inconsistent", |rows| column(rows, "yaw", |_, v| format!("{:.3}", v.to_degrees()))),
    ("gyro in degrees", "Inconsistent", |rows| column(rows, "yaw_rate", |_, v| format!("{:.3}", v.to_degrees()))),
    ("speed in km/h", "Inconsistent", |rows| column(rows, "v", |_, v| format!("{:.3}", v * 3.6))),
    ("mirrored steering", "Inconsistent", |rows| column(rows, "cmd_steer", |_, v| format!("{:.5}", -v))),
    ("x and y swapped", "Inconsistent", |rows| swap(rows, "x", "y")),
    ("speed and yaw swapped", "Inconsistent", |rows| swap(rows, "v", "yaw")),
    ("commands swapped", "Inconsistent", |rows| swap(rows, "cmd_steer", "cmd_accel")),
    ("frozen speed", "ZeroVariance", |rows| column(rows, "v", |_, _| "12.0".to_owned())),
    ("frozen gyro", "ZeroVariance", |rows| column(rows, "yaw_rate", |_, _| "0.0".to_owned())),
    ("one sample", "TooShort", |rows| rows.truncate(2)),
    ("empty drive", "TooShort", |rows| rows.truncate(1)),
    ("three seconds", "TooShort", |rows| rows.truncate(60)),
    ("time goes back", "TimeGoesBack", |rows| rows.swap(100, 105)),
    ("time stands still", "TimeGoesBack", |rows| rows[100][0] = rows[99][0].clone()),
    ("a hole of ten seconds", "TimeGap", |rows| {
        rows.drain(100..300);
    }),
    ("stamps in milliseconds", "TimeGap", |rows| column(rows, "t", |_, v| format!("{:.0}", v * 1000.0))),
    ("mirrored gyro", "Inconsistent", |rows| column(rows, "yaw_rate", |_, v| format!("{:.4}", -v))),
    ("brake in place of steering", "Inconsistent", |rows| swap(rows, "cmd_accel", "v")),
    ("no gyro for ten seconds", "ColumnGap", |rows| {
        let at = place(rows, "yaw_rate");
        rows[100..300].iter_mut().for_each(|row| row[at] = String::new());
    }),
    ("no more gyro", "ColumnGap", |rows| {
        let at = place(rows, "yaw_rate");
        rows[400..].iter_mut().for_each(|row| row[at] = String::new());
    }),
    ("no steering command for ten seconds", "ColumnGap", |rows| {
        let at = place(rows, "cmd_steer");
        rows[100..300].iter_mut().for_each(|row| row[at] = String::new());
    }),
    ("no command", "MissingColumn", |rows| {
        let at = place(rows, "cmd_steer");
        rows[0][at] = "something".to_owned();
    }),
];

fn case_folder(folder: &Path) {
    synthetic::write_case(folder, 3, &|_| {}).expect("the case can be written");
}

fn name(error: &CaseError) -> String {
    let text = format!("{error:?}");
    text.split([' ', '{', '(']).next().unwrap_or_default().to_owned()
}

fn judged(folder: &Path, options: &Options) -> Result<Diagnosis, CaseError> {
    Ok(diagnose(&Case::read(folder)?, options))
}

#[test]
fn spoiled_drives_are_refused_by_name() {
    let folder = tempfile::tempdir().expect("a folder");
    case_folder(folder.path());
    let path = folder.path().join("drive_0.csv");
    let whole = fs::read_to_string(&path).expect("the drive");
    let mut faults = Vec::new();
    for (what, expected, edit) in EDITS {
        fs::write(&path, changed(&whole, edit)).expect("the drive can be spoiled");
        let found = match judged(folder.path(), &Options { quick: true, ..Options::default() }) {
            Ok(diagnosis) => format!("{:?}", diagnosis.verdict),
            Err(error) => name(&error),
        };
        if found != *expected {
            faults.push(format!("{what}: expected {expected}, got {found}"));
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}

#[test]
fn two_million_rows_of_one_value_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    case_folder(folder.path());
    let mut text = String::from("t,cmd_steer,cmd_accel,x,y,yaw,v,yaw_rate,ax,ay,steer_meas,v_wheel\n");
    text.push_str(&"1,1,1,1,1,1,1,1,1,1,1,1\n".repeat(2_000_000));
    fs::write(folder.path().join("drive_1.csv"), text).expect("the drive can be written");
    let error = judged(folder.path(), &Options::default()).expect_err("such a log is refused");
    assert_eq!(name(&error), "TooLarge");
}

/// Sensors in another unit or frozen, by what is said of them.
const SUSPECT: &[(&str, Edit)] = &[
    ("v_wheel is 3.60 times v", |rows| column(rows, "v_wheel", |_, v| format!("{:.3}", 3.6 * v))),
    ("times the change of speed (r = ", |rows| column(rows, "ax", |_, v| format!("{:.4}", v / 9.81))),
    ("ax has a mean of ", |rows| column(rows, "ax", |_, v| format!("{:.2}", v + 9.81))),
    ("cmd_accel goes against the change of speed", |rows| column(rows, "cmd_accel", |_, v| format!("{:.3}", -v))),
    ("yaw_rate keeps one value for ", |rows| {
        column(rows, "yaw_rate", |k, v| if k < 400 { format!("{v:.4}") } else { "0.01".to_owned() });
    }),
];

#[test]
fn suspect_sensors_are_named_once_for_all_drives() {
    let folder = tempfile::tempdir().expect("a folder");
    case_folder(folder.path());
    let paths: Vec<_> = (0..4).map(|drive| folder.path().join(format!("drive_{drive}.csv"))).collect();
    let wholes: Vec<String> = paths.iter().map(|path| fs::read_to_string(path).expect("the drive")).collect();
    let plain = Case::read(folder.path()).expect("a case").warnings;
    for (said, edit) in SUSPECT {
        assert!(!plain.iter().any(|w| w.contains(said)), "{plain:?}");
        for (path, whole) in paths.iter().zip(&wholes) {
            fs::write(path, changed(whole, edit)).expect("the drive can be written");
        }
        let warnings = Case::read(folder.path()).expect("odd but usable").warnings;
        let own: Vec<&String> = warnings.iter().filter(|w| w.contains(said)).collect();
        assert!(matches!(own[..], [one] if one.starts_with("in 4 of 4 drives: ")), "{said}: {warnings:?}");
    }
}

#[test]
fn a_car_that_drives_backwards_has_no_swapped_columns() {
    let folder = tempfile::tempdir().expect("a folder");
    case_folder(folder.path());
    change(&folder.path().join("drive_0.csv"), |rows| {
        column(rows, "yaw", |_, v| format!("{:.5}", v + std::f64::consts::PI));
        for name in ["v", "v_wheel", "ax", "ay", "cmd_steer", "steer_meas", "cmd_accel"] {
            column(rows, name, |_, v| format!("{:.5}", -v));
        }
    });
    Case::read(folder.path()).expect("it is one that reverses");
}

#[test]
fn a_missing_or_absurd_description_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    case_folder(folder.path());
    let path = folder.path().join("meta.json");
    let whole = fs::read_to_string(&path).expect("the description");
    let rows: [(&str, String, &str); 5] = [
        ("weightless", whole.replace("\"mass\": 1500.0", "\"mass\": 0.0"), "AbsurdVehicle"),
        (
            "negative stiffness",
            whole.replace("\"cornering_stiffness_rear\": 98000.0", "\"cornering_stiffness_rear\": -5.0"),
            "AbsurdVehicle",
        ),
        ("not JSON", whole.replace('}', ""), "Json"),
        ("no drive", whole.replace("\"drives\": [", "\"drives\": [],\"others\": ["), "NoDrive"),
        ("a drive that is not there", whole.replace("drive_2.csv", "drive_9.csv"), "Read"),
    ];
    for (what, text, expected) in rows {
        fs::write(&path, text).expect("the description can be spoiled");
        let error = judged(folder.path(), &Options::default()).expect_err(what);
        assert_eq!(name(&error), expected, "{what}");
    }
    fs::remove_file(&path).expect("the description can be removed");
    let error = judged(folder.path(), &Options::default()).expect_err("no description");
    assert_eq!(name(&error), "Read");
}

#[test]
fn missing_channels_are_masked_and_told() {
    let folder = tempfile::tempdir().expect("a folder");
    case_folder(folder.path());
    for drive in 0..4 {
        let path = folder.path().join(format!("drive_{drive}.csv"));
        change(&path, |rows| {
            ["steer_meas", "ay", "v_wheel"].iter().for_each(|name| column(rows, name, |_, _| String::new()));
        });
    }
    let diagnosis = judged(folder.path(), &Options { quick: true, ..Options::default() }).expect("a verdict");
    assert_eq!(diagnosis.verdict, Verdict::None);
    assert!(diagnosis.warnings.iter().any(|w| w.contains("steer_meas")));
}

/// What may be done to a log without making it another one: the verdict stays `none`, oddities are told.
const HARMLESS: &[(&str, Edit)] = &[
    ("every second row", |rows| {
        let mut k = 0;
        rows.retain(|_| {
            k += 1;
            k % 2 == 1 || k == 1
        });
    }),
    ("holes of a third of a second", |rows| {
        let mut k = 0;
        rows.retain(|_| {
            k += 1;
            k % 90 > 6 || k < 10
        });
    }),
    ("lost cells", |rows| {
        let at = place(rows, "yaw_rate");
        rows.iter_mut().skip(1).step_by(7).for_each(|row| row[at] = String::new());
    }),
    ("heading wrapped", |rows| {
        column(rows, "yaw", |_, v| format!("{:.4}", v.sin().atan2(v.cos())));
    }),
    ("columns in another order, one unknown", |rows| {
        rows.iter_mut().for_each(|row| row.rotate_left(3));
        rows[0].push("note".to_owned());
        rows.iter_mut().skip(1).for_each(|row| row.push("0".to_owned()));
    }),
    ("late start of the clock", |rows| column(rows, "t", |_, v| format!("{:.3}", v + 1.6e9))),
];

#[test]
fn harmless_differences_change_no_verdict_and_cost_no_minutes() {
    let folder = tempfile::tempdir().expect("a folder");
    case_folder(folder.path());
    let wholes: Vec<String> =
        (0..4).map(|k| fs::read_to_string(folder.path().join(format!("drive_{k}.csv"))).expect("the drive")).collect();
    let mut faults = Vec::new();
    let mut judge = |what: &str, edit: &dyn Fn(&str) -> String| {
        for (k, whole) in wholes.iter().enumerate() {
            fs::write(folder.path().join(format!("drive_{k}.csv")), edit(whole)).expect("the drive can be written");
        }
        let start = std::time::Instant::now();
        match judged(folder.path(), &Options { quick: true, ..Options::default() }) {
            Ok(d) if d.verdict == Verdict::None => {}
            // another sample rate is told, and no library effect is accused of it
            Ok(d) if d.chosen.is_empty() && d.warnings.iter().any(|w| w.contains("samples a second")) => {}
            Ok(d) => faults.push(format!("{what}: {:?} {:?}", d.verdict, d.chosen)),
            Err(error) => faults.push(format!("{what}: {error}")),
        }
        let secs = start.elapsed().as_secs_f64();
        if secs > 120.0 {
            faults.push(format!("{what}: took {secs:.0} s"));
        }
    };
    judge("byte order mark and CRLF", &|whole| format!("\u{feff}{}", whole.replace('\n', "\r\n")));
    for (what, edit) in HARMLESS {
        judge(what, &|whole| changed(whole, edit));
    }
    assert!(faults.is_empty(), "{faults:#?}");
}

#[test]
fn a_command_that_keeps_one_value_is_no_reason_to_refuse() {
    let folder = tempfile::tempdir().expect("a folder");
    case_folder(folder.path());
    let keep = |drive: usize, name: &str| {
        let path = folder.path().join(format!("drive_{drive}.csv"));
        change(&path, |rows| column(rows, name, |_, _| "0.02".to_owned()));
    };
    let told = || -> Vec<String> {
        let case = Case::read(folder.path()).expect("a constant command is no dead column");
        case.warnings.into_iter().filter(|w| w.contains("keeps one value")).collect()
    };
    keep(0, "cmd_accel");
    assert_eq!(told(), Vec::<String>::new(), "one drive of steady pedals");
    (1..4).for_each(|drive| keep(drive, "cmd_accel"));
    assert!(matches!(&told()[..], [warning] if warning.starts_with("cmd_accel ")), "{:?}", told());
    let diagnosis = judged(folder.path(), &Options { quick: true, ..Options::default() }).expect("a verdict");
    assert!(diagnosis.warnings.iter().any(|w| w.starts_with("cmd_accel keeps one value")));
}

#[test]
fn effects_of_other_drivers_are_not_judged_where_nobody_follows() {
    let folder = tempfile::tempdir().expect("a folder");
    case_folder(folder.path());
    for drive in 0..4 {
        fs::remove_file(folder.path().join(format!("agents_{drive}.csv"))).expect("followers to take away");
    }
    let diagnosis = judged(folder.path(), &Options { quick: true, ..Options::default() }).expect("a verdict");
    let of_others: Vec<&str> = library().iter().filter(|e| Part::of(e) == Part::Following).map(|e| e.id).collect();
    let judged = |id: &str| diagnosis.effects.iter().any(|e| e.id == id);
    assert!(of_others.iter().all(|id| !judged(id)), "{:?}", diagnosis.effects);
    assert!(!diagnosis.not_testable.is_empty());
    assert!(diagnosis.not_testable.iter().all(|id| of_others.contains(&id.as_str())), "{:?}", diagnosis.not_testable);
    let sum = diagnosis.effects.iter().map(|e| e.probability).sum::<f64>() + diagnosis.p_none + diagnosis.p_unknown;
    assert!((sum - 1.0).abs() < 1e-9, "{sum}");
}

#[test]
fn noisier_sensors_are_told_from_effects() {
    let folder = tempfile::tempdir().expect("a folder");
    case_folder(folder.path());
    for drive in 0..4 {
        let path = folder.path().join(format!("drive_{drive}.csv"));
        change(&path, |rows| {
            for (name, noise) in
                [("x", 0.03), ("y", 0.03), ("yaw", 0.005), ("v", 0.07), ("yaw_rate", 0.008), ("v_wheel", 0.09)]
            {
                // a white sequence without a generator: fractional parts of multiples of an irrational number, squared
                let white = |k: usize| {
                    let u = (k as f64 * 0.618_034 * (name.len() + drive + 1) as f64 * 7.13).powi(2).fract();
                    (u - 0.5) * 12.0_f64.sqrt() * noise
                };
                column(rows, name, |k, v| format!("{:.4}", v + white(k)));
            }
        });
    }
    let diagnosis = judged(folder.path(), &Options { quick: true, ..Options::default() }).expect("a verdict");
    assert_eq!(diagnosis.floor_source, "self");
    assert_eq!(diagnosis.verdict, Verdict::None, "{:?}", diagnosis.chosen);
}

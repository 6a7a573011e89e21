//! Logs in by a mapping file: each kind of wrong mapping or log is found and named, right ones give no finding.

use std::fmt::Write as _;
use std::path::Path;

use ds_vehicle_logs::{LogError, Mapping};

const MAPPING: &str = r#"
[log]
name = "test"
[time]
column = "stamp"
unit = "s"
[[drive]]
file = "log.csv"
[channels]
cmd_steer = { column = "steer" }
cmd_accel = { column = "accel" }
x = { column = "x" }
y = { column = "y" }
yaw = { column = "yaw" }
v = { column = "v" }
yaw_rate = { column = "gyro" }
ax = { column = "ax" }
ay = { column = "ay" }
steer_meas = { column = "angle" }
v_wheel = { column = "wheel" }
[nominal]
model = "linear"
mass = 1500.0
wheelbase = 2.7
"#;

/// Columns of the made log, in order.
const COLUMNS: [&str; 12] = ["stamp", "steer", "accel", "x", "y", "yaw", "v", "gyro", "ax", "ay", "angle", "wheel"];

/// A right log: a kinematic vehicle at 100 Hz whose yaw rate follows the command by 0.1 s.
fn rows() -> Vec<[f64; 12]> {
    let (step, base) = (0.01, 2.7);
    let steer = |t: f64| 0.04 * (0.9 * t).sin() + 0.02 * (2.3 * t).sin();
    let accel = |t: f64| 1.2 * (0.5 * t).sin();
    let (mut x, mut y, mut yaw, mut v) = (100.0, -40.0, 0.4, 12.0);
    (0..4000)
        .map(|k| {
            let t = f64::from(k) * step;
            let angle = steer(t - 0.1);
            let rate = v * f64::tan(angle) / base;
            let ripple = 0.02 * (f64::from(k) * 1.7).sin();
            let row = [t, steer(t), accel(t), x, y, yaw, v, rate, accel(t) + ripple, v * rate + ripple, angle, v];
            x += step * v * f64::cos(yaw);
            y += step * v * f64::sin(yaw);
            yaw += step * rate;
            v += step * accel(t);
            row
        })
        .collect()
}

fn write(folder: &Path, rows: &[[f64; 12]]) {
    let mut text = COLUMNS.join(",");
    for row in rows {
        let cells: Vec<String> = row.iter().map(|v| if v.is_nan() { String::new() } else { v.to_string() }).collect();
        let _infallible = write!(text, "\n{}", cells.join(","));
    }
    std::fs::write(folder.join("log.csv"), text).expect("writable folder");
}

fn mapping(folder: &Path, text: &str) -> Result<Mapping, LogError> {
    let path = folder.join("mapping.toml");
    std::fs::write(&path, text).expect("writable folder");
    Mapping::read(&path)
}

/// Returns channel and problem of every finding of a log edited row by row, under an edited mapping.
fn findings(edit: &dyn Fn(usize, &mut [f64; 12]), map: (&str, &str)) -> Vec<(String, String, String)> {
    let folder = tempfile::tempdir().expect("temporary folder");
    let mut rows = rows();
    rows.iter_mut().enumerate().for_each(|(k, row)| edit(k, row));
    write(folder.path(), &rows);
    assert!(MAPPING.contains(map.0), "{map:?}");
    let mapping = mapping(folder.path(), &MAPPING.replace(map.0, map.1)).expect("right mapping");
    let found = mapping.check(folder.path()).expect("readable log");
    found.into_iter().map(|f| (f.channel, f.problem, f.proposal)).collect()
}

fn scale(column: usize, factor: f64) -> impl Fn(usize, &mut [f64; 12]) {
    move |_, row| row[column] *= factor
}

/// What is wrong, how the log and the mapping are edited, the channel accused and a part of the cure.
type Wrong =
    (&'static str, Box<dyn Fn(usize, &mut [f64; 12])>, (&'static str, &'static str), &'static str, &'static str);

#[test]
#[expect(clippy::too_many_lines, reason = "a table, one row per kind of wrongness")]
fn every_kind_of_wrongness_is_found_and_its_cure_proposed() {
    let none = ("", "");
    let rows: Vec<Wrong> = vec![
        ("steering to the right", Box::new(scale(1, -1.0)), none, "cmd_steer", "negate"),
        ("steering in degrees", Box::new(scale(1, 57.29578)), none, "cmd_steer", "unit = \"deg\""),
        ("steering wheel", Box::new(scale(1, 15.0)), none, "cmd_steer", "scale = 0.06"),
        (
            "steering wheel in degrees",
            Box::new(scale(1, 15.0 * 57.29578)),
            none,
            "cmd_steer",
            "unit = \"deg\", channels.cmd_steer.scale = 0.06",
        ),
        (
            "radians said to be degrees",
            Box::new(scale(1, 1.0)),
            ("column = \"steer\"", "column = \"steer\", unit = \"deg\""),
            "cmd_steer",
            "unit = \"rad\"",
        ),
        ("encoder to the right", Box::new(scale(10, -1.0)), none, "steer_meas", "negate"),
        ("milliseconds", Box::new(scale(0, 1e3)), none, "time", "unit = \"ms\""),
        ("nanoseconds", Box::new(scale(0, 1e9)), none, "time", "unit = \"ns\""),
        (
            "duplicated stamps",
            Box::new(|k, row| {
                if k % 50 == 1 {
                    row[0] -= 0.01
                }
            }),
            none,
            "time",
            "dropped",
        ),
        (
            "time goes back",
            Box::new(|k, row| {
                if k % 500 == 7 {
                    row[0] -= 0.3
                }
            }),
            none,
            "time",
            "sort",
        ),
        (
            "hole",
            Box::new(|k, row| {
                if k > 1200 {
                    row[0] += 2.5
                }
            }),
            none,
            "time",
            "cut there",
        ),
        (
            "short hole",
            Box::new(|k, row| {
                if k > 1200 {
                    row[0] += 0.3
                }
            }),
            none,
            "time",
            "straight lines bridge",
        ),
        ("jitter", Box::new(|k, row| row[0] += 0.004 * (k % 2) as f64), none, "time", "stamp of the measurement"),
        ("empty channel", Box::new(|_, row| row[8] = f64::NAN), none, "ax", "remove it"),
        ("no such column", Box::new(|_, _| ()), ("\"gyro\"", "\"gyros\""), "yaw_rate", "another column"),
        ("mirrored pose", Box::new(scale(4, -1.0)), none, "yaw", "negate"),
        ("x and y swapped", Box::new(|_, row| row.swap(3, 4)), none, "yaw", "swap"),
        (
            "yaw from another axis",
            Box::new(|_, row| row[5] -= std::f64::consts::FRAC_PI_2),
            none,
            "yaw",
            "offset = 1.57",
        ),
        (
            "left-handed pose",
            Box::new(|_, row| {
                row[4] *= -1.0;
                row[5] *= -1.0;
            }),
            none,
            "yaw_rate",
            "ned",
        ),
        ("yaw in degrees", Box::new(scale(5, 57.29578)), none, "yaw", "unit = \"deg\""),
        ("gyro in degrees", Box::new(scale(7, 57.29578)), none, "yaw_rate", "unit = \"deg/s\""),
        ("speed in km/h", Box::new(scale(6, 3.6)), none, "v", "unit = \"km/h\""),
        ("wheel speed in km/h", Box::new(scale(11, 3.6)), none, "v_wheel", "unit = \"km/h\""),
        ("forward acceleration by reaction", Box::new(scale(8, -1.0)), none, "ax", "negate"),
        ("side acceleration to the right", Box::new(scale(9, -1.0)), none, "ay", "negate"),
        ("acceleration in g", Box::new(scale(9, 1.0 / 9.80665)), none, "ay", "unit = \"g\""),
        ("axes swapped", Box::new(|_, row| row.swap(8, 9)), none, "ax", "swap"),
        ("vertical axis", Box::new(|_, row| row[8] += 9.81), none, "ax", "vertical"),
        ("drive command backwards", Box::new(scale(2, -1.0)), none, "cmd_accel", "negate"),
        (
            "command logged late",
            Box::new(|_, row| {
                let t = row[0] - 0.5;
                row[1] = 0.04 * (0.9 * t).sin() + 0.02 * (2.3 * t).sin();
            }),
            none,
            "cmd_steer",
            "when it is sent",
        ),
    ];
    for (name, edit, map, channel, proposal) in rows {
        let found = findings(&*edit, map);
        assert!(found.iter().any(|f| f.0 == channel && f.2.contains(proposal)), "{name}: {found:?}");
    }
}

#[test]
fn right_logs_give_no_finding() {
    let none = ("", "");
    let right: Vec<(&str, (&str, &str))> = vec![
        ("as it is", none),
        ("a mapping of fewer channels", ("ax = { column = \"ax\" }\n", "")),
        (
            "drive command from the speed",
            ("cmd_accel = { column = \"accel\" }", "cmd_accel = { derived_from = \"v\" }"),
        ),
    ];
    for (name, map) in right {
        let found = findings(&|_, _| (), map);
        assert!(found.is_empty(), "{name}: {found:?}");
    }
    // what a mapping says, it also undoes
    let undone: Vec<(usize, f64, &str, &str)> = vec![
        (1, -57.29578, "column = \"steer\"", "column = \"steer\", unit = \"deg\", negate = true"),
        (6, 3.6, "column = \"v\"", "column = \"v\", unit = \"km/h\""),
        (0, 1e3, "unit = \"s\"", "unit = \"ms\""),
    ];
    for (column, factor, from, to) in undone {
        let found = findings(&scale(column, factor), (from, to));
        assert!(found.is_empty(), "{to}: {found:?}");
    }
    let ned = findings(
        &|_, row| {
            row.swap(3, 4);
            row[5] = std::f64::consts::FRAC_PI_2 - row[5];
        },
        ("[[drive]]", "[frame]\npose = \"ned\"\n[[drive]]"),
    );
    assert!(ned.is_empty(), "{ned:?}");
}

#[test]
fn a_case_of_a_right_log_holds_the_channels_in_si_and_can_be_read() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write(folder.path(), &rows());
    let text = MAPPING
        .replace("name = \"test\"", "name = \"test\"\npiece_secs = 10.0")
        .replace("cmd_accel = { column = \"accel\" }", "cmd_accel = { derived_from = \"v\" }");
    let out = folder.path().join("case");
    let drives = mapping(folder.path(), &text).and_then(|m| m.case(folder.path(), &out)).expect("right log").drives;
    assert_eq!(drives.len(), 4);
    assert_eq!(drives[0].derived, vec!["cmd_accel"]);
    let case = ds_dynamics::case::Case::read(&out).expect("a case of the practice schema");
    assert_eq!(case.meta.split(), (vec![0, 1, 2], vec![3]));
    // what the command was computed from is no witness of it
    assert!(case.drives.iter().all(|d| d.v.is_none() && d.v_wheel.is_none() && d.ax.is_none() && d.ay.is_some()));
    let drive = &case.drives[1];
    let t = drive.start_secs + 2.0;
    assert!((drive.cmd_steer[40] - (0.04 * (0.9 * t).sin() + 0.02 * (2.3 * t).sin())).abs() < 1e-5);
    assert!((drive.cmd_accel[40] - 1.2 * (0.5 * t).sin()).abs() < 0.02);
}

#[test]
fn one_mapping_serves_logs_that_it_does_not_list() {
    let folder = tempfile::tempdir().expect("temporary folder");
    write(folder.path(), &rows());
    let listed = "[[drive]]\nfile = \"log.csv\"\n";
    let unlisted = mapping(folder.path(), &MAPPING.replace(listed, "")).expect("right mapping");
    let error = unlisted.check(folder.path()).expect_err("no log is named");
    assert!(error.to_string().contains("drive"), "{error}");
    let log = folder.path().join("log.csv");
    let one = unlisted.for_log(&log);
    assert_eq!(one.log.name, "log");
    let imported = one.case(folder.path(), &folder.path().join("case")).expect("a case");
    assert!((imported.drives[0].secs() - 39.95).abs() < 0.1, "{}", imported.drives[0].secs());
    let part = "[[drive]]\nfile = \"log.csv\"\nfrom_secs = 20.0\n";
    let part = mapping(folder.path(), &MAPPING.replace(listed, part)).expect("right mapping").for_log(&log);
    let imported = part.case(folder.path(), &folder.path().join("part")).expect("a case");
    assert!((imported.drives[0].secs() - 19.95).abs() < 0.1, "{}", imported.drives[0].secs());
}

#[test]
fn errors_name_file_line_and_column() {
    let folder = tempfile::tempdir().expect("temporary folder");
    let check = |csv: &str, map: (&str, &str), wanted: &[&str]| {
        std::fs::write(folder.path().join("log.csv"), csv).expect("writable folder");
        let out = folder.path().join("case");
        let error = mapping(folder.path(), &MAPPING.replace(map.0, map.1))
            .and_then(|m| m.case(folder.path(), &out).map(|_| ()))
            .expect_err("a wrong log");
        let source = std::error::Error::source(&error).map(ToString::to_string).unwrap_or_default();
        let text = format!("{error}: {source}");
        assert!(wanted.iter().all(|w| text.contains(w)), "{text} lacks {wanted:?}");
    };
    let head = COLUMNS.join(",");
    let zeros = ["0"; 12].join(",");
    check(
        &format!("{head}\n{zeros}\n0,0,0,0,0,zwei,0,0,0,0,0,0\n"),
        ("", ""),
        &["line 3", "column 6", "zwei", "log.csv"],
    );
    check(&format!("{head}\n{zeros}\n1,2\n"), ("", ""), &["line 3", "2 cells", "log.csv"]);
    check(&format!("{head}\n{zeros}\n"), ("\"steer\"", "\"steering\""), &["steering", "log.csv"]);
    check(&format!("{head}\n{zeros}\n"), ("", ""), &["log.csv"]);
    check(&head, ("unit = \"s\"", "unit = \"h\""), &["time.unit"]);
    check(&head, ("column = \"v\"", "column = \"v\", unit = \"deg\""), &["channels.v", "deg"]);
    check(&head, ("column = \"v\"", "colum = \"v\""), &["mapping.toml", "line 15", "colum"]);
    check(&head, ("wheelbase = 2.7", "wheelbase = 2.7\nlf = 1.0"), &["nominal"]);
    check(&head, ("cmd_steer =", "steer_meas_2 ="), &["cmd_steer"]);
}

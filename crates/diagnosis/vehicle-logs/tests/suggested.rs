//! A mapping proposed for a text file: channels by the names of columns, units by header or data, layouts of all kinds; what
//! cannot be told is said, and what is no table is refused by what is wrong with it.

use std::fmt::Write as _;
use std::path::Path;

use ds_vehicle_logs::{Mapping, Suggestion, suggest};

const DEGREES: f64 = 180.0 / std::f64::consts::PI;

/// A moment of a drive of a vehicle of 2.7 m wheelbase, SI.
struct Moment {
    t: f64,
    steer: f64,
    accel: f64,
    x: f64,
    y: f64,
    yaw: f64,
    v: f64,
    rate: f64,
}

/// A drive of 40 s at 50 Hz: the yaw rate follows the steering by 0.1 s.
fn drive() -> Vec<Moment> {
    let steer = |t: f64| 0.05 * (0.9 * t).sin() + 0.03 * (2.3 * t).sin();
    let (mut x, mut y, mut yaw, mut v) = (0.0, 0.0, 0.4, 12.0);
    let mut moments = Vec::new();
    for k in 0..2000 {
        let t = 0.02 * f64::from(k);
        let accel = 1.5 * (0.5 * t).sin();
        let rate = v * f64::tan(steer(t - 0.1)) / 2.7;
        moments.push(Moment { t, steer: steer(t), accel, x, y, yaw, v, rate });
        x += 0.02 * v * f64::cos(yaw);
        y += 0.02 * v * f64::sin(yaw);
        yaw += 0.02 * rate;
        v += 0.02 * accel;
    }
    moments
}

/// A column: its name, and its value at a moment.
type Of = (&'static str, fn(&Moment) -> f64);

/// Writes a table with some sign between cells; returns what is proposed for it.
fn proposed(
    folder: &Path,
    delimiter: &str,
    columns: &[Of],
    edit: &dyn Fn(String) -> String,
) -> Result<Suggestion, String> {
    let names: Vec<&str> = columns.iter().map(|column| column.0).collect();
    let mut text = names.join(delimiter);
    for moment in drive() {
        let cells: Vec<String> = columns.iter().map(|column| format!("{:.6}", column.1(&moment))).collect();
        let _infallible = write!(text, "\n{}", cells.join(delimiter));
    }
    std::fs::write(folder.join("log.csv"), edit(text)).expect("writable folder");
    suggest(&folder.join("log.csv")).map_err(|error| error.to_string())
}

fn kept(text: String) -> String {
    text
}

/// Returns the mapping of a proposal that the check of `gap import` has nothing to say of.
fn sound(folder: &Path, proposed: &Suggestion) -> Mapping {
    let mapping = Mapping::parse(&proposed.text).unwrap_or_else(|error| panic!("{error}: {}", proposed.text));
    let found = mapping.check(folder).expect("a readable log");
    assert!(found.is_empty(), "{found:?}: {}", proposed.text);
    mapping
}

/// Returns a channel's entry in a proposal.
fn entry<'a>(proposed: &'a Suggestion, channel: &str) -> &'a str {
    let line = proposed.text.lines().find(|line| line.starts_with(&format!("{channel} = ")));
    line.unwrap_or_else(|| panic!("no {channel}: {}", proposed.text))
}

fn doubts(proposed: &Suggestion, words: &str) -> bool {
    proposed.undecided.iter().any(|sentence| sentence.contains(words))
}

const TOLD: [Of; 8] = [
    ("time_s", |m| m.t),
    ("speed_kmh", |m| 3.6 * m.v),
    ("steering_wheel_deg", |m| 15.0 * DEGREES * m.steer),
    ("ax_g", |m| m.accel / 9.806_65),
    ("ay [m/s^2]", |m| m.v * m.rate),
    ("YawRate (deg/s)", |m| DEGREES * m.rate),
    ("lat", |m| 48.1 + DEGREES * m.y / 6_371_000.0),
    ("lon", |m| 11.5 + DEGREES * m.x / (6_371_000.0 * f64::cos(48.1 / DEGREES))),
];

#[test]
fn a_header_tells_channels_and_units() {
    let folder = tempfile::tempdir().expect("a folder");
    let proposed = proposed(folder.path(), ",", &TOLD, &kept).expect("a table");
    let mapping = sound(folder.path(), &proposed);
    let names: Vec<&str> = mapping.channels.keys().map(String::as_str).collect();
    assert_eq!(names, ["ax", "ay", "cmd_accel", "cmd_steer", "v", "x", "y", "yaw_rate"]);
    for (channel, part) in [
        ("v", "unit = \"km/h\""),
        ("ax", "unit = \"g\""),
        ("yaw_rate", "unit = \"deg/s\""),
        ("x", "fix = [\"lat\", \"lon\"]"),
        ("cmd_steer", "unit = \"deg\", scale = 0.06"),
        ("cmd_accel", "derived_from = \"v\""),
    ] {
        assert!(entry(&proposed, channel).contains(part), "{channel}: {}", proposed.text);
    }
    for words in
        ["mass: ", "cmd_steer: a steering wheel that turns 1", "cmd_steer: no steering command", "cmd_accel: no drive"]
    {
        assert!(doubts(&proposed, words), "{words}: {:?}", proposed.undecided);
    }
    // metres from the first fix, whichever the sphere
    let case = folder.path().join("case");
    mapping.case(folder.path(), &case).expect("a case");
    let table = std::fs::read_to_string(case.join("drive_0.csv")).expect("a drive");
    let last: Vec<f64> =
        table.lines().last().expect("rows").split(',').map(|c| c.parse().unwrap_or(f64::NAN)).collect();
    let end = drive().pop().expect("moments");
    assert!((last[3] - end.x).abs() < 0.01 * end.x.abs() + 1.0 && (last[4] - end.y).abs() < 0.01 * end.y.abs() + 1.0);
}

#[test]
fn data_tell_the_units_that_a_header_does_not() {
    let folder = tempfile::tempdir().expect("a folder");
    // without a place: the change of speed and of heading alone
    let columns: [Of; 7] = [
        ("t", |m| m.t),
        ("v", |m| 3.6 * m.v),
        ("ax", |m| m.accel / 9.806_65),
        ("yaw", |m| m.yaw),
        ("yaw_rate", |m| DEGREES * m.rate),
        ("ay", |m| m.v * m.rate / 9.806_65),
        ("steering_cmd", |m| DEGREES * m.steer),
    ];
    let found = proposed(folder.path(), ",", &columns, &kept).expect("a table");
    for (channel, unit) in [("v", "km/h"), ("ax", "g"), ("ay", "g"), ("yaw_rate", "deg/s"), ("cmd_steer", "deg")] {
        assert!(entry(&found, channel).contains(&format!("unit = {unit:?}")), "{channel}: {}", found.text);
    }
    assert!(doubts(&found, "mass: ") && !doubts(&found, "neither header nor data"), "{:?}", found.undecided);
    let wheelbase = sound(folder.path(), &found).nominal.wheelbase.expect("a wheelbase");
    assert!((wheelbase - 2.7).abs() < 0.05, "{}", found.text);
    // a compass's heading is known by the way
    let columns: [Of; 6] = [
        ("t", |m| m.t),
        ("x", |m| m.x),
        ("y", |m| m.y),
        ("heading", |m| (90.0 - DEGREES * m.yaw).rem_euclid(360.0)),
        ("speed", |m| m.v),
        ("steer_cmd", |m| m.steer),
    ];
    let found = proposed(folder.path(), ",", &columns, &kept).expect("a table");
    sound(folder.path(), &found);
    assert!(entry(&found, "yaw").contains("unit = \"deg\", negate = true"), "{}", found.text);
    // a speed alone is of no unit that data tell
    let columns: [Of; 3] = [("t", |m| m.t), ("speed", |m| m.v), ("steer_cmd", |m| m.steer)];
    let found = proposed(folder.path(), ",", &columns, &kept).expect("a table");
    assert!(doubts(&found, "v: neither header nor data tell its unit; m/s is taken (values"), "{:?}", found.undecided);
    assert!(doubts(&found, "cmd_steer: turns do not tell"), "{:?}", found.undecided);
    // a header that the data contradict is believed and doubted
    let columns: [Of; 5] =
        [("t", |m| m.t), ("x", |m| m.x), ("y", |m| m.y), ("speed_mps", |m| 3.6 * m.v), ("steer_cmd", |m| m.steer)];
    let found = proposed(folder.path(), ",", &columns, &kept).expect("a table");
    assert!(entry(&found, "v").contains("unit = \"m/s\""), "{}", found.text);
    assert!(doubts(&found, "position and v differ by a factor of 3.6"), "{:?}", found.undecided);
}

/// What parts cells, what is made of the text, and what the mapping then says.
type Layout<'a> = (&'static str, &'a dyn Fn(String) -> String, &'static str);

#[test]
fn layouts_of_all_kinds_are_told() {
    let comma = |text: String| text.replace('.', ",");
    let below = |text: String| text.replacen('\n', "\n[s];[km/h];[°];[g];;;;\n", 1);
    let marked = |text: String| format!("\u{feff}{}", text.replace('\n', "\r\n"));
    let quoted = |text: String| text.replace(';', "\";\"").replace('\n', "\"\n\"");
    let stamps = |text: String| text.replacen("time_s", "time", 1);
    let layouts: [Layout<'_>; 6] = [
        (";", &|text| comma(text), "delimiter = \";\"\ndecimal = \",\""),
        (";", &|text| marked(below(comma(text.replacen("_kmh", "", 1)))), "skip = 1"),
        ("\t", &|text| stamps(marked(text)), "delimiter = \"tab\""),
        (",", &|text| format!("# {text}"), "comment = \"#\"\nheader = \"commented\""),
        (",", &|text| format!("# of a test drive\n# in May\n{text}"), "comment = \"#\"\n"),
        (";", &|text| format!("\"{}\"", quoted(text)), "delimiter = \";\""),
    ];
    let folder = tempfile::tempdir().expect("a folder");
    for (delimiter, edit, words) in layouts {
        let found = proposed(folder.path(), delimiter, &TOLD, edit).expect(words);
        assert!(found.text.contains(words), "{words}: {}", found.text);
        sound(folder.path(), &found);
        assert!(entry(&found, "v").contains("unit = \"km/h\""), "{words}: {}", found.text);
    }
    // stamps in milliseconds, a name that stands twice and one with a comma in it
    let columns: [Of; 6] = [
        ("stamp", |m| (1e3 * m.t).round() + 1.7e12),
        ("\"speed, front\"", |m| m.v),
        ("speed", |m| m.v),
        ("speed", |m| 2.0 * m.v),
        ("delta_cmd_steer", |m| m.steer),
        ("yaw_rate", |m| m.rate),
    ];
    let found = proposed(folder.path(), ",", &columns, &kept).expect("a table");
    assert!(found.text.contains("unit = \"ms\" # by the usual step of 20"), "{}", found.text);
    assert!(entry(&found, "v").starts_with("v = { column = \"speed, front\""), "{}", found.text);
    assert!(doubts(&found, "it could be \"speed\" (column 3), \"speed\" (column 4) too"), "{:?}", found.undecided);
    let found = proposed(folder.path(), ",", &columns[2..4], &|text| text.replacen("speed,speed", "t,t", 1));
    assert!(doubts(&found.expect("stamps"), "stamps are in t too"));
}

#[test]
fn what_is_no_table_is_refused_by_what_is_wrong() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("log.csv");
    for (bytes, words) in [
        (&b""[..], "fewer than two lines"),
        (b"time,v\n", "fewer than two lines"),
        (b"0.0,1.0\n0.1,1.1\n", "holds numbers and no names"),
        (b"time,v\n0.0,1,5\n0.1,1,6\n", "parts all of its lines"),
        (b"speed,steer\n1.0,0.1\n1.1,0.1\n", "called as stamps are"),
        (b"time,v\n2026-11-29T10:00:00,1\n2026-11-29T10:00:01,1\n", "are no numbers"),
        (b"time,v\n1,1.0\n1,1.1\n", "do not grow"),
        (b"\xff\xfet\0i\0m\0e\0,\0v\0\n\0", "zero byte"),
        (b"time,v\n0.0,1.0\n0.1,--\n", "no number"),
    ] {
        std::fs::write(&path, bytes).expect("writable");
        let said = match suggest(&path) {
            Ok(found) => found.undecided.join("\n"),
            Err(error) => error.to_string(),
        };
        assert!(said.contains(words), "{words}: {said}");
    }
    let error = suggest(folder.path()).expect_err("a folder of text").to_string();
    assert!(error.contains("of text files name one"), "{error}");
}

//! Bags in by a mapping file: three containers of one drive give one case; commands of other kinds and what is refused.

use std::path::{Path, PathBuf};

use ds_vehicle_logs::{LogError, Mapping, suggest};

const BAGS: [(&str, &str); 3] = [("mcap", "drive.mcap"), ("rosbag1", "drive.bag"), ("rosbag2", "drive.db3")];

const MAPPING: &str = r#"
[log]
name = "bag"
format = "mcap"
[[drive]]
file = "drive.mcap"
[channels]
cmd_steer = { topic = "/cmd", field = "drive.steering_angle" }
cmd_accel = { topic = "/cmd", field = "drive.acceleration" }
x = { topic = "/pose", field = "pose.position.x" }
y = { topic = "/pose", field = "pose.position.y" }
yaw = { topic = "/pose", field = "pose.orientation" }
v = { topic = "/twist", field = "twist.linear.x" }
yaw_rate = { topic = "/twist", field = "twist.angular.z" }
[nominal]
model = "linear"
mass = 1500.0
wheelbase = 2.7
"#;

fn bags() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../bags/tests/data")
}

fn mapping(text: &str) -> Result<Mapping, LogError> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("mapping.toml");
    std::fs::write(&path, text).expect("writable");
    Mapping::read(&path)
}

/// Returns the table of the one drive that a mapping makes, and its first drive.
fn table(text: &str) -> Result<String, LogError> {
    let out = tempfile::tempdir().expect("a folder");
    mapping(text)?.case(&bags(), out.path())?;
    Ok(std::fs::read_to_string(out.path().join("drive_0.csv")).expect("a drive"))
}

/// Returns a column of a table.
fn column(table: &str, name: &str) -> Vec<f64> {
    let mut lines = table.lines();
    let place = lines.next().and_then(|head| head.split(',').position(|n| n == name)).expect("such a column");
    lines.map(|line| line.split(',').nth(place).and_then(|cell| cell.parse().ok()).expect("a number")).collect()
}

#[test]
fn three_containers_of_one_drive_give_one_case() {
    let tables: Vec<String> = BAGS
        .iter()
        .map(|(format, file)| {
            let text = MAPPING.replace("\"mcap\"", &format!("{format:?}")).replace("drive.mcap", file);
            let found = mapping(&text).and_then(|m| m.check(&bags())).expect("a sound bag");
            assert!(found.is_empty(), "{file}: {found:?}");
            table(&text).expect("a sound bag")
        })
        .collect();
    assert!(tables.iter().all(|table| *table == tables[0]));
    // 10 Hz becomes 20: measurements by lines, commands as the value in force
    let (t, steer, v) = (column(&tables[0], "t"), column(&tables[0], "cmd_steer"), column(&tables[0], "v"));
    assert_eq!(t.len(), 169);
    let sent = |t: f64| 0.035 * (0.61 * t).sin() + 0.02 * (1.7 * t).sin() * (0.013 * t).sin();
    assert!((steer[40] - sent(2.0)).abs() < 2e-6 && (steer[41] - sent(2.0)).abs() < 2e-6);
    assert!((v[0] - 14.0).abs() < 1e-4 && (v[1] - 0.5 * (v[0] + v[2])).abs() < 1e-4);
}

#[test]
fn a_case_of_a_bag_can_be_read_by_the_diagnosis() {
    let out = tempfile::tempdir().expect("a folder");
    mapping(MAPPING).and_then(|m| m.case(&bags(), out.path())).expect("a sound bag");
    let case = ds_dynamics::case::Case::read(out.path()).expect("a case of the practice schema");
    assert_eq!(case.drives.len(), 1);
    assert!(case.drives[0].yaw.is_some() && case.drives[0].ay.is_none());
}

#[test]
fn a_fix_gives_the_place_and_the_stamp_can_be_that_of_the_receipt() {
    // every fourth row has a fix: its lines cut the corners of a bend
    let own = table(MAPPING).expect("a sound bag");
    let text = MAPPING
        .replace("{ topic = \"/pose\", field = \"pose.position.x\" }", "{ topic = \"/fix\", field = \"east\" }")
        .replace("{ topic = \"/pose\", field = \"pose.position.y\" }", "{ topic = \"/fix\", field = \"north\" }");
    let fixed = table(&text).expect("a sound bag");
    for name in ["x", "y"] {
        let (a, b) = (column(&own, name), column(&fixed, name));
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1.0), "{name}");
    }
    // every topic 4 ms later: the same drive
    let text = MAPPING.replace(" }\n", ", stamp = \"log\" }\n");
    assert_eq!(table(&text).expect("a sound bag"), own);
}

#[test]
fn commands_of_other_kinds_become_what_is_asked_of_each_kilogram() {
    let accel = column(&table(MAPPING).expect("a sound bag"), "cmd_accel");
    let of = |more: &str| {
        let text = MAPPING.replace("\"drive.acceleration\"", &format!("\"drive.acceleration\", {more}"));
        column(&table(&text).expect(more), "cmd_accel")
    };
    for (more, factor) in [
        ("kind = \"force\"", 1.0 / 1500.0),
        ("kind = \"force\", unit = \"kN\"", 1.0 / 1.5),
        ("kind = \"torque\", ratio = 9.0, radius_m = 0.3", 9.0 / (0.3 * 1500.0)),
    ] {
        let asked = of(more);
        assert!(asked.iter().zip(&accel).all(|(a, b)| (a - b * factor).abs() < 1e-4), "{more}");
    }
    // the vehicle's own speed as the one asked for: the acceleration that follows it is the vehicle's
    let text = MAPPING.replace(
        "{ topic = \"/cmd\", field = \"drive.acceleration\" }",
        "{ topic = \"/twist\", field = \"twist.linear.x\", kind = \"wheel_speed\" }",
    );
    let (asked, v) = (table(&text).expect("a sound bag"), column(&table(MAPPING).expect("a sound bag"), "v"));
    let asked = column(&asked, "cmd_accel");
    let gained: f64 = asked.iter().map(|a| a * 0.05).sum();
    assert!((gained - (v[v.len() - 1] - v[0])).abs() < 0.2, "{gained}");
}

#[test]
fn what_cannot_be_a_mapping_is_refused_by_name() {
    for (from, to, hints) in [
        (
            "\"drive.acceleration\"",
            "\"drive.acceleration\", kind = \"pedal\"",
            &["channels.cmd_accel", "pedal", "derive"][..],
        ),
        (
            "\"drive.acceleration\"",
            "\"drive.acceleration\", kind = \"torque\"",
            &["channels.cmd_accel", "ratio", "radius_m"],
        ),
        ("\"drive.steering_angle\"", "\"drive.steering_angle\", ratio = 3.0", &["channels.cmd_steer", "cmd_accel"]),
        ("topic = \"/pose\", field = \"pose.orientation\"", "column = \"yaw\"", &["channels.yaw", "topic and field"]),
        ("topic = \"/pose\", field = \"pose.orientation\"", "topic = \"/pose\"", &["channels.yaw", "topic and field"]),
        ("[nominal]", "[time]\ncolumn = \"t\"\n[nominal]", &["time", "bag"]),
        ("\"/twist\"", "\"/velocity\"", &["/velocity", "/twist (geometry_msgs"]),
        ("\"twist.linear.x\"", "\"twist.linear.w\"", &["twist.linear.w", "\"x\""]),
        ("format = \"mcap\"", "format = \"csv\"", &["time", "absent"]),
    ] {
        assert!(MAPPING.contains(from), "{from}");
        let error = table(&MAPPING.replace(from, to)).expect_err(to).to_string();
        assert!(hints.iter().all(|hint| error.contains(hint)), "{to}: {error}");
    }
}

#[test]
fn a_measurement_that_calls_itself_a_command_is_refused() {
    let measured = MAPPING.replace(
        "[nominal]",
        "steer_meas = { topic = \"/cmd\", field = \"drive.steering_angle\", scale = 1.02 }\n[nominal]",
    );
    let error = table(&measured).expect_err("the command is the sensor").to_string();
    assert!(error.contains("cmd_steer") && error.contains("echo") && error.contains("steer_meas"), "{error}");
    let found = mapping(&measured).and_then(|m| m.check(&bags())).expect("a sound bag");
    assert!(found.iter().any(|f| f.channel == "cmd_steer" && f.problem.contains("echo")), "{found:?}");
}

#[test]
fn a_proposed_mapping_is_a_right_one_and_says_what_no_log_holds() {
    for (_, file) in BAGS {
        let proposed = suggest(&bags().join(file)).expect("a sound bag");
        assert!(proposed.undecided.iter().any(|sentence| sentence.starts_with("mass: ")), "{:?}", proposed.undecided);
        let mapping = Mapping::parse(&proposed.text).expect("a right mapping");
        assert!((mapping.nominal.wheelbase.expect("a wheelbase") - 2.7).abs() < 0.05, "{}", proposed.text);
        let names: Vec<&str> = mapping.channels.keys().map(String::as_str).collect();
        assert_eq!(names, ["cmd_accel", "cmd_steer", "v", "x", "y", "yaw", "yaw_rate"]);
        let found = mapping.check(&bags()).expect("a sound bag");
        assert!(found.is_empty(), "{file}: {found:?}");
        assert_eq!(table(&proposed.text).expect("a sound bag"), table(MAPPING).expect("a sound bag"));
    }
}

#[test]
fn what_stands_in_for_a_command_is_told() {
    let folder = tempfile::tempdir().expect("a folder");
    let whole = std::fs::read(bags().join("drive.mcap")).expect("the bag");
    let proposed = |from: &str, to: &str| {
        assert_eq!(from.len(), to.len(), "the bytes around keep their places");
        let mut changed = whole.clone();
        for at in 0..changed.len() - from.len() {
            if &changed[at..at + from.len()] == from.as_bytes() {
                changed[at..at + from.len()].copy_from_slice(to.as_bytes());
            }
        }
        let path = folder.path().join("drive.mcap");
        std::fs::write(&path, changed).expect("writable");
        suggest(&path).expect("a sound bag")
    };
    // an asked speed in place of the measured one; nothing but the place says how the vehicle moved
    let asked = proposed("/twist", "/cmd_v");
    let mapping = Mapping::parse(&asked.text).expect("a right mapping");
    assert!(!mapping.channels.contains_key("v") && !mapping.channels.contains_key("yaw_rate"), "{}", asked.text);
    // no command of steering at all
    let unsteered = proposed("steering_angle", "something_else");
    assert!(unsteered.undecided.iter().any(|s| s.starts_with("cmd_steer: no")), "{:?}", unsteered.undecided);
    let error = Mapping::parse(&unsteered.text).expect_err("the simulator needs every command").to_string();
    assert!(error.contains("cmd_steer"), "{error}");
    // no drive command but an unused field: the one that the vehicle needs
    let undriven = proposed("float32 acceleration", "float32 accelerating");
    assert!(
        undriven.undecided.iter().any(|s| s.starts_with("cmd_accel: drive.speed of /cmd never")),
        "{:?}",
        undriven.undecided
    );
    assert!(undriven.text.contains("cmd_accel = { derived_from = \"v\" }"), "{}", undriven.text);
    Mapping::parse(&undriven.text).expect("a right mapping");
}

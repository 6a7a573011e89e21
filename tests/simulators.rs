//! A command as the nominal simulator: the built-in car served through the protocol is diagnosed as itself, one that dies is
//! started once more and its windows are left out, and what is no simulator is refused by what is wrong with it.

use std::path::Path;
use std::process::Command;
use std::sync::LazyLock;

use crate::harness::{dreamstream, python, python_with, workspace};
use ds_effect::{Plant, find};
use serde_json::Value;

fn case(folder: &Path, seed: u64, injected: &[(&str, f64)]) -> String {
    let edit = |plant: &mut Plant| {
        for (id, value) in injected {
            let effect = find(id).expect("the effect is in the library");
            let mut values = effect.neutral();
            values[0] = *value;
            (effect.apply)(&values, plant);
        }
    };
    ds_dynamics::synthetic::write_case(folder, seed, &edit).expect("the case can be written");
    folder.display().to_string()
}

/// Diagnoses a case with a command; returns the diagnosis, or what was said on standard error.
fn diagnosed(case: &str, simulator: Option<&str>) -> Result<Value, String> {
    let out = tempfile::tempdir().expect("a folder");
    let mut arguments = vec!["gap", "diagnose", case, "--quick", "--no-pages", "--out"];
    let path = out.path().display().to_string();
    arguments.push(&path);
    arguments.extend(simulator.iter().flat_map(|command| ["--simulator", command]));
    let ended = dreamstream(&arguments).output().expect("the binary runs");
    if !ended.status.success() {
        return Err(String::from_utf8_lossy(&ended.stderr).into_owned());
    }
    let name = Path::new(case).file_name().expect("a name");
    let text = std::fs::read_to_string(out.path().join(name).join("diagnosis.json")).expect("a diagnosis");
    Ok(serde_json::from_str(&text).expect("JSON"))
}

/// Builds the example FMU of one version of the standard for a case; None where FMPy or a C compiler is missing.
fn unit(python: &Path, case: &str, version: &str, folder: &Path) -> Option<String> {
    let path = folder.join(format!("car-{version}.fmu"));
    let script = workspace().join("clients/python/examples/fmu/build.py");
    let made = Command::new(python).arg(script).args(["--fmi", version, "--case", case, "-o"]).arg(&path).output();
    let made = made.expect("python starts");
    if !made.status.success() {
        eprintln!("skipped: the FMU cannot be built: {}", String::from_utf8_lossy(&made.stderr));
        return None;
    }
    Some(path.display().to_string())
}

#[test]
fn a_functional_mock_up_unit_is_the_nominal_simulator() {
    let Some(python) = python().and_then(|_| python_with("fmpy", &["fmpy"])) else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let case = case(folder.path(), 71, &[("steer_delay", 0.12)]);
    let known = std::env::var_os("PATH").expect("there is a PATH");
    let folders = python.parent().map(Path::to_path_buf).into_iter().chain(std::env::split_paths(&known));
    let path = std::env::join_paths(folders).expect("a PATH with one folder more");
    for version in ["1", "2", "3"] {
        let Some(unit) = unit(&python, &case, version, folder.path()) else { return };
        let out = folder.path().join(version).display().to_string();
        let words = ["gap", "diagnose", &case, "--quick", "--no-pages", "--out", &out, "--simulator", &unit];
        let ended = dreamstream(&words).env("PATH", &path).output().expect("the binary runs");
        assert!(ended.status.success(), "FMI {version}: {}", String::from_utf8_lossy(&ended.stderr));
        let name = folder.path().file_name().expect("a name");
        let text = std::fs::read_to_string(Path::new(&out).join(name).join("diagnosis.json")).expect("a diagnosis");
        let said: Value = serde_json::from_str(&text).expect("JSON");
        assert_eq!(said["chosen"], serde_json::json!(["steer_delay"]), "FMI {version}: {text}");
        let delay = said["effects"][0]["value"].as_f64().expect("a value");
        assert!((delay - 0.12).abs() < 0.02 && said["rollouts"].as_u64() > Some(50), "FMI {version}: {delay}");
        std::fs::remove_file(&unit).expect("the file was there");
        let gone = dreamstream(&words).env("PATH", &path).output().expect("the binary runs");
        assert!(String::from_utf8_lossy(&gone.stderr).contains("there is no file"), "FMI {version}");
    }
}

fn program() -> String {
    format!("'{}'", env!("CARGO_BIN_EXE_dreamstream"))
}

/// A load that a car carries, kg.
const LOAD: (&str, f64) = ("payload", 250.0);

/// The folder of a case with [`LOAD`] and its diagnosis by the built-in car.
static LADEN: LazyLock<(tempfile::TempDir, Value)> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a folder");
    let own = diagnosed(&case(folder.path(), 77, &[LOAD]), None).expect("a verdict");
    (folder, own)
});

/// Holds a diagnosis through the protocol to that of the same case by the built-in car, and to what was injected.
fn alike(own: &Value, other: &Value, injected: &[(&str, f64)]) {
    assert_eq!((&own["verdict"], &own["chosen"]), (&other["verdict"], &other["chosen"]), "{injected:?}");
    let rollouts = other["rollouts"].as_u64().expect("rollouts are counted");
    assert!(rollouts > 50 && rollouts <= 2000 && own.get("rollouts").is_none(), "{rollouts}");
    if let Some((id, value)) = injected.first() {
        let found = other["effects"][0]["value"].as_f64().expect("a value");
        assert_eq!(other["effects"][0]["id"], *id);
        assert!((found - value).abs() < 0.15 * value, "{id}: {found} instead of {value}");
    }
}

#[test]
fn the_built_in_car_behind_the_protocol_is_diagnosed_as_itself() {
    for (seed, injected) in [(71, &[("steer_delay", 0.12)][..]), (72, &[])] {
        let folder = tempfile::tempdir().expect("a folder");
        let case = case(folder.path(), seed, injected);
        let served = format!("{} gap serve {{case}}", program());
        let (own, other) = (diagnosed(&case, None).expect("a verdict"), diagnosed(&case, Some(&served)).expect("one"));
        alike(&own, &other, injected);
    }
}

#[test]
fn how_far_is_measured_by_runs_of_the_simulator() {
    let (out, fresh) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    let (fitted, other) = (LADEN.0.path().display().to_string(), case(fresh.path(), 78, &[LOAD]));
    let served = format!("{} gap serve {{case}}", program());
    let out = out.path().display().to_string();
    let diagnose = ["gap", "diagnose", &fitted, "--quick", "--no-pages", "--out", &out, "--simulator", &served];
    assert!(dreamstream(&diagnose).output().expect("the binary runs").status.success());
    let name = LADEN.0.path().file_name().expect("a name").to_string_lossy().into_owned();
    let diagnosis = format!("{out}/{name}/diagnosis.json");
    let text = std::fs::read_to_string(&diagnosis).expect("a diagnosis");
    alike(&LADEN.1, &serde_json::from_str(&text).expect("JSON"), &[LOAD]);
    let evaluated = |command: Option<&str>| {
        let words = ["gap", "evaluate", &diagnosis, &other].into_iter();
        let words: Vec<&str> = words.chain(command.iter().flat_map(|command| ["--simulator", *command])).collect();
        dreamstream(&words).output().expect("the binary runs")
    };
    let rows = |output: &std::process::Output| -> Vec<Value> {
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice(&output.stdout).expect("JSON")
    };
    let (own, by) = (rows(&evaluated(None)), rows(&evaluated(Some(&served))));
    let errors = |rows: &[Value]| {
        let far = rows.iter().find(|row| row["metric"] == "position_2s").expect("the metric");
        ["before", "after"].map(|state| far[state].as_f64().expect("an error"))
    };
    let (own, by) = (errors(&own), errors(&by));
    assert!(by[1] < 0.7 * by[0], "{by:?}");
    assert!(own.iter().zip(by).all(|(own, by)| (own - by).abs() < 0.05 * own), "{own:?} {by:?}");
    // a simulator without parameters and with a port along the road alone cannot carry a load
    let refused = evaluated(Some(&shell(HELLO, "cat >/dev/null")));
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && said.contains("neither a parameter nor a port for"), "{said}");
}

#[test]
fn a_baseline_speaks_of_the_simulator_that_it_was_learned_with() {
    let folders = [(); 3].map(|()| tempfile::tempdir().expect("a folder"));
    let effects: [&[(&str, f64)]; 3] = [&[], &[], &[("drag_add", 1.2)]];
    let cases: Vec<String> =
        folders.iter().zip([81, 82, 83]).zip(effects).map(|((folder, seed), e)| case(folder.path(), seed, e)).collect();
    let served = format!("{} gap serve {{case}}", program());
    let [file, out] = ["baseline.json", "out"].map(|name| folders[0].path().join(name).display().to_string());
    let learned = ["gap", "baseline", &cases[0], &cases[1], "--simulator", &served, "-o", &file];
    let learned = dreamstream(&learned).output().expect("the binary runs");
    assert!(learned.status.success(), "{}", String::from_utf8_lossy(&learned.stderr));
    let words = ["gap", "diagnose", &cases[2], "--quick", "--no-pages", "--out", &out, "--baseline", &file];
    let refused = String::from_utf8_lossy(&dreamstream(&words).output().expect("the binary runs").stderr).into_owned();
    assert!(
        refused.contains("its nominal one is the built-in car, the baseline's is a simulator of step"),
        "{refused}"
    );
    let ended = dreamstream(&[&words[..], &["--simulator", &served]].concat()).output().expect("the binary runs");
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    let name = folders[2].path().file_name().expect("a name");
    let text = std::fs::read_to_string(Path::new(&out).join(name).join("diagnosis.json")).expect("a diagnosis");
    let said: Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(
        (&said["chosen"], &said["floor_source"]),
        (&serde_json::json!(["drag_add"]), &"baseline".into()),
        "{text}"
    );
    let found = said["effects"][0]["value"].as_f64().expect("a value");
    assert!((found - 1.2).abs() < 0.15 * 1.2, "{found} instead of 1.2");
}

#[test]
fn what_cannot_be_declared_is_pushed_through_the_ports() {
    let (folder, own) = &*LADEN;
    let served = format!("{} gap serve {{case}} --ports-only", program());
    let other = diagnosed(&folder.path().display().to_string(), Some(&served)).expect("a verdict");
    assert_eq!((&own["verdict"], &own["chosen"]), (&other["verdict"], &other["chosen"]));
    let gain = |said: &Value| said["effects"][0]["evidence_gain"].as_f64().expect("a gain");
    assert_eq!(own["effects"][0]["id"], other["effects"][0]["id"]);
    assert!((gain(own) - gain(&other)).abs() < 1.0, "{} behind ports, {} declared", gain(&other), gain(own));
}

#[test]
fn one_that_dies_is_started_once_more_and_what_it_misses_is_said() {
    let folder = tempfile::tempdir().expect("a folder");
    let case = case(folder.path(), 74, &[("steer_delay", 0.12)]);
    // the hello and so many resets and steps, then the end; and the same once more
    let once = |requests: u32| format!("sh -c \"sed -u {requests}q | {} gap serve {{case}}\"", program());
    let said = diagnosed(&case, Some(&once(401))).expect("a verdict");
    let warnings = said["warnings"].to_string();
    assert!(warnings.contains("started anew") && warnings.contains("did not answer in"), "{warnings}");
    let refused = diagnosed(&case, Some(&once(1))).expect_err("no window is answered");
    assert!(refused.contains("answered in none of") && refused.contains("ended when asked for"), "{refused}");
}

/// What a simulator without parameters says of itself.
const HELLO: &str = r#"{"hello":1,"dt":0.01,"parameters":[],"ports":["drive"],"channels":["x","y","yaw","v","yaw_rate","ax","ay"],"deterministic":true,"snapshot":false,"reset_state":["x","y","yaw","v","yaw_rate"],"instances":1}"#;

/// A simulator in a shell: its hello, and what is then done with the requests.
fn shell(hello: &str, then: &str) -> String {
    format!("sh -c 'printf \"%s\\\\n\" \"$0\"; {then}' '{hello}'")
}

#[test]
fn one_that_fails_twice_is_asked_no_more() {
    let folder = tempfile::tempdir().expect("a folder");
    let case = case(folder.path(), 76, &[]);
    for (then, failure) in
        [("cat >/dev/null", "gave no answer"), ("while read line; do echo what; done", "no such reply")]
    {
        let refused = diagnosed(&case, Some(&shell(HELLO, then))).expect_err("no window is answered");
        let said = ["answered in none of", "failed twice", failure];
        assert!(said.iter().all(|words| refused.contains(words)), "{refused}");
    }
}

#[test]
fn what_is_no_simulator_is_refused_by_what_is_wrong() {
    let folder = tempfile::tempdir().expect("a folder");
    let case = case(folder.path(), 75, &[]);
    let hello = |changed: &str| {
        shell(&HELLO.replace(r#""instances":1"#, &format!(r#""instances":1{changed}"#)), "cat >/dev/null")
    };
    let rows = [
        ("false".to_owned(), "ended when asked for hello"),
        ("sh -c 'echo tyres are cold >&2'".to_owned(), "tyres are cold"),
        ("sh -c 'echo ready; cat'".to_owned(), "no such reply"),
        ("./no/such/program".to_owned(), "ended when asked for hello"),
        ("./no/car.fmu".to_owned(), "dreamstream.fmu"),
        (hello("").replace("0.01", "3.0"), "dt"),
        (hello("").replace("\"v\",", ""), "channels"),
        (hello("").replace("\"hello\":1", "\"hello\":9"), "hello"),
        (hello(",\"includes\":[\"wings\"]"), "wings"),
    ];
    for (command, named) in rows {
        let refused = diagnosed(&case, Some(&command)).expect_err(&command);
        assert!(refused.contains(named), "{command}: {refused}");
    }
}

/// Looks for a law in a case with a command or without; returns the diagnosis and what was printed.
fn discovered(case: &str, simulator: Option<&str>) -> (Value, String) {
    let out = tempfile::tempdir().expect("a folder");
    let path = out.path().display().to_string();
    let words = ["gap", "discover", case, "--quick", "--no-pages", "--out", &path].into_iter();
    let words: Vec<&str> = words.chain(simulator.iter().flat_map(|command| ["--simulator", command])).collect();
    let ended = dreamstream(&words).output().expect("the binary runs");
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    let name = Path::new(case).file_name().expect("a name");
    let text = std::fs::read_to_string(out.path().join(name).join("diagnosis.json")).expect("a diagnosis");
    let said = String::from_utf8_lossy(&ended.stdout).split_whitespace().collect::<Vec<_>>().join(" ");
    (serde_json::from_str(&text).expect("JSON"), said)
}

/// Writes a case of a car that obeys a law; returns its path.
fn lawful(folder: &Path, seed: u64, text: &str) -> String {
    let edit = |plant: &mut Plant| plant.laws.push(ds_effect::Law::parse(text).expect("a law"));
    ds_dynamics::synthetic::write_case(folder, seed, &edit).expect("the case can be written");
    folder.display().to_string()
}

#[test]
fn a_law_is_found_against_a_simulator_and_measured_through_its_ports() {
    // injected, its insertion, and how a term of it begins
    for (text, insertion, expression) in [
        ("steering.linkage: 0.008*pos(accel)", "steering", "pos(accel)"),
        ("drive: -0.04*v*abs(ay)", "drive", ""),
        ("sensor.yaw_rate: 0.012*sin(0.2)", "sensor.yaw_rate", "sin(0.2"),
    ] {
        let folder = tempfile::tempdir().expect("a folder");
        let case = lawful(folder.path(), 4150, text);
        let served = format!("{} gap serve {{case}}", program());
        let ((own, _), (by, _)) = (discovered(&case, None), discovered(&case, Some(&served)));
        for found in [&own, &by].map(|diagnosis| &diagnosis["discovery"]) {
            assert_eq!(found["insertion"][0]["id"], insertion, "{text}: {found}");
            let terms = found["law"]["terms"].as_array().unwrap_or_else(|| panic!("{text}: {found}"));
            let begins = |term: &Value| term["expression"].as_str().is_some_and(|e| e.starts_with(expression));
            assert!(terms.iter().any(begins), "{text}: {}", found["law"]["text"]);
            assert!(found["heldout_gain"].as_f64() > Some(0.0), "{text}: {found}");
        }
        assert_eq!(own["discovery"]["law"]["port"], by["discovery"]["law"]["port"], "{text}");
        assert!(by["rollouts"].as_u64().is_some_and(|rollouts| rollouts <= 2000) && own.get("rollouts").is_none());
        let shares = [&own, &by].map(|said| said["discovery"]["share_explained"]["value"].as_f64().expect("a share"));
        assert!(shares[1] > 0.6 && (shares[0] - shares[1]).abs() < 0.15, "{text}: {shares:?}");
        let saved = |said: &Value| {
            let far = said["how_far"].as_array().expect("rows").iter().find(|row| row["metric"] == "position_2s");
            far.expect("the metric")["saved"].clone()
        };
        assert_eq!(saved(&own).is_null(), saved(&by).is_null(), "{text}: {} {}", saved(&own), saved(&by));
        assert_eq!(by["corrected_model"]["laws"][0], by["discovery"]["law"]["text"]);
    }
}

#[test]
fn a_law_at_a_port_that_a_simulator_lacks_is_found_and_said_to_be_unmeasured() {
    let folder = tempfile::tempdir().expect("a folder");
    let case = lawful(folder.path(), 4150, "drive: -0.04*v*abs(ay)");
    // the built-in car, whose hello names no port along the road
    let served = format!("sh -c \"{} gap serve {{case}} | sed -u 's/\\[.drive.,/[/'\"", program());
    let (by, said) = discovered(&case, Some(&served));
    let (found, laws) = (&by["discovery"], &by["corrected_model"]["laws"]);
    assert_eq!(found["law"]["port"], "drive", "{found}");
    assert!(found.get("share_explained").is_none() && laws.is_null(), "{by}");
    assert!(found["kept_gain"].as_f64() > Some(0.0), "{found}");
    assert!(said.contains("This simulator has no port at drive"), "{said}");
}

//! The gap diagnosis from the command line: a labelled case is named, a broken one is refused and spoils no other.

use crate::harness::{dreamstream, shared, workspace};
use serde_json::Value;

#[test]
fn a_labelled_case_is_named_and_a_broken_one_spoils_no_other() {
    let Some(practice) = shared("data/gap-practice") else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let broken = folder.path().join("broken");
    std::fs::create_dir(&broken).expect("a folder");
    std::fs::write(broken.join("meta.json"), "{}").expect("is written");
    let out = folder.path().join("out");
    let case = practice.join("case_03");
    let paths = [&broken, &case, &out].map(|path| path.display().to_string());
    let diagnosed = dreamstream(&["gap", "diagnose", &paths[0], &paths[1], "--quick", "--out", &paths[2]]).output();
    let diagnosed = diagnosed.expect("the binary runs");
    let error = String::from_utf8_lossy(&diagnosed.stderr).into_owned();
    assert_eq!(diagnosed.status.code(), Some(1), "{error}");
    assert!(error.contains("broken") && error.contains("1 of 2 cases"), "{error}");
    let path = out.join("case_03/diagnosis.json");
    let text = std::fs::read_to_string(&path).expect("a diagnosis");
    let diagnosis: Value = serde_json::from_str(&text).expect("JSON");
    let labels = std::fs::read_to_string(practice.join("labels.json")).expect("labels");
    let labels: Value = serde_json::from_str(&labels).expect("JSON");
    assert_eq!(diagnosis["verdict"], "single");
    assert_eq!(diagnosis["effects"][0]["id"], labels["case_03"]["effects"][0]["id"]);
    let diagnosis = path.display().to_string();
    let arguments = ["gap", "evaluate", &diagnosis, &paths[1], "--drives", "3"];
    let evaluated = dreamstream(&arguments).output().expect("the binary runs");
    let shrinks: Value = serde_json::from_slice(&evaluated.stdout).expect("shrinks are JSON");
    let position = shrinks.as_array().and_then(|all| all.iter().find(|one| one["metric"] == "position_2s"));
    let share = position.and_then(|one| one["share_explained"].as_f64()).expect("a share");
    assert!(share > 0.5, "{shrinks}");
}

/// One real car on two floors: against a log of the rubber floor, circles on tape and tiles lack grip.
#[test]
fn logs_that_are_named_become_cases_and_another_floor_is_named() {
    let Some(logs) = shared("data/dart-jetracer") else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name).display().to_string();
    let run = |arguments: &[&str]| {
        let output = dreamstream(arguments).output().expect("the binary runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    };
    let rubber = "car_1_Datarecording_09_09_2024_16_05_28steer015_ramp";
    let tiles = "car_1_Datarecording_09_09_2024_17_58_23steer_neg03_ramp";
    let file = |folder: &str, name: &str| logs.join(format!("{folder}/{name}.csv")).display().to_string();
    let files = [file("81_throttle_ramps", rubber), file("81_circles_tape_and_tiles", tiles)];
    let (cases, baseline, out) = (path("cases"), path("baseline.json"), path("out"));
    run(&["gap", "import", "configs/gap/dart-jetracer-floor.toml", &files[0], &files[1], "-o", &cases]);
    run(&["gap", "baseline", &format!("{cases}/{rubber}"), "-o", &baseline]);
    let case = format!("{cases}/{tiles}");
    run(&["gap", "diagnose", &case, "--baseline", &baseline, "--quick", "--no-pages", "--out", &out]);
    let text = std::fs::read_to_string(path(&format!("out/{tiles}/diagnosis.json"))).expect("a diagnosis");
    let found: Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!((&found["verdict"], &found["effects"][0]["id"]), (&"single".into(), &"mu".into()), "{found}");
    let mapping = "configs/gap/dart-jetracer-floor.toml";
    let twins = dreamstream(&["gap", "import", mapping, &files[0], &files[0], "-o", &cases]).output();
    let error = String::from_utf8_lossy(&twins.expect("the binary runs").stderr).into_owned();
    assert!(error.contains("would be one case"), "{error}");
}

#[test]
fn finished_cases_of_a_folder_are_kept_and_changed_ones_diagnosed_anew() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let [one, two, out] = ["cases/one", "cases/two", "out"].map(|name| folder.path().join(name));
    for (seed, case) in [(81, &one), (82, &two)] {
        std::fs::create_dir_all(case).expect("a folder");
        ds_dynamics::synthetic::write_case(case, seed, &|_| {}).expect("the case can be written");
    }
    let (cases, to) = (folder.path().join("cases").display().to_string(), out.display().to_string());
    let call = |more: &[&str]| {
        let arguments = [&["gap", "diagnose", &cases, "--quick", "--no-pages", "--out", &to], more].concat();
        assert!(dreamstream(&arguments).output().expect("the binary runs").status.success());
        ["one", "two"].map(|name| std::fs::read(out.join(name).join("diagnosis.json")).expect("a diagnosis"))
    };
    let first = call(&[]);
    assert_eq!(call(&["--resume"]), first, "the seconds that it took are those of the first call");
    let table = two.join("drive_0.csv");
    let text = std::fs::read_to_string(&table).expect("a table");
    let cut = text.rsplit_once("\n").and_then(|(rest, _)| rest.rsplit_once("\n")).expect("rows").0;
    std::fs::write(&table, format!("{cut}\n")).expect("written");
    let again = call(&["--resume"]);
    assert!(again[0] == first[0] && again[1] != first[1]);
}

#[test]
fn folders_without_cases_are_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let arguments = ["gap", "diagnose", &folder.path().display().to_string()];
    let refused = dreamstream(&arguments).output().expect("the binary runs");
    assert!(String::from_utf8_lossy(&refused.stderr).contains("meta.json"), "{refused:?}");
}

#[test]
fn a_bag_becomes_a_case_without_a_file_written_by_hand() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let bags = workspace().join("crates/diagnosis/bags/tests/data");
    let [mapping, case] = ["mapping.toml", "case"].map(|name| folder.path().join(name).display().to_string());
    for name in ["drive.mcap", "drive.bag", "drive.db3"] {
        let bag = bags.join(name).display().to_string();
        let proposed =
            dreamstream(&["gap", "import", "--suggest", &bag, "-o", &mapping]).output().expect("the binary runs");
        let said = String::from_utf8_lossy(&proposed.stdout).into_owned();
        assert!(proposed.status.success() && said.contains("not decided: mass"), "{proposed:?}");
        let arguments = ["gap", "import", &mapping, &bags.display().to_string(), "-o", &case];
        let imported = dreamstream(&arguments).output().expect("the binary runs");
        let said = String::from_utf8_lossy(&imported.stdout).into_owned();
        assert!(imported.status.success() && said.contains("0 findings") && said.contains("drive 0"), "{imported:?}");
    }
    let table = std::fs::read_to_string(folder.path().join("case/drive_0.csv")).expect("a drive");
    assert!(table.starts_with("t,cmd_steer,cmd_accel,x,y,yaw,v,yaw_rate\n"), "{}", &table[..60]);
    let refused = dreamstream(&["gap", "import", "--suggest", &mapping]).output().expect("the binary runs");
    assert!(String::from_utf8_lossy(&refused.stderr).contains("no MCAP"), "{refused:?}");
}

/// Drives a small set of shipped scenarios with frames of the reference camera.
fn drive(out: &std::path::Path, more: &[&str]) {
    let scenarios = workspace().join("scenarios/base");
    let files =
        ["free-curve", "roundabout", "lead-braking"].map(|name| scenarios.join(format!("{name}.scenario.json")));
    let mut arguments = vec!["run".to_owned()];
    arguments.extend(files.iter().filter(|file| file.exists()).map(|file| file.display().to_string()));
    let fixed = ["--observation", "layout", "--policy", "lattice", "--duration", "8", "--no-pictures", "--out"];
    arguments.extend(fixed.map(str::to_owned));
    arguments.push(out.display().to_string());
    arguments.extend(more.iter().map(|word| (*word).to_owned()));
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let driven = dreamstream(&words).output().expect("the binary runs");
    assert!(driven.status.success(), "{}", String::from_utf8_lossy(&driven.stderr));
}

fn logs(run: &std::path::Path) -> Vec<std::path::PathBuf> {
    let entries = std::fs::read_dir(run.join("real")).expect("vehicle logs");
    let mut found: Vec<_> = entries.flatten().map(|entry| entry.path()).collect();
    found.retain(|path| path.extension().is_some_and(|end| end == "mcap"));
    found.sort();
    found
}

#[test]
fn sealed_runs_that_differ_in_the_effect_differ_in_numbers_alone() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let runs = ["5", "11"].map(|seed| {
        let (out, answer) = (folder.path().join(seed), folder.path().join(format!("{seed}.sealed")));
        drive(&out, &["--seal", &answer.display().to_string(), "--seal-seed", seed]);
        let opened = dreamstream(&["gap", "unseal", &answer.display().to_string()]).output().expect("the binary runs");
        (out, String::from_utf8_lossy(&opened.stdout).into_owned())
    });
    assert_ne!(runs[0].1, runs[1].1, "two draws with one answer");
    let [first, second] = runs.each_ref().map(|(out, _)| logs(out));
    assert!(!first.is_empty());
    for (a, b) in first.iter().zip(&second) {
        let tells = |path| ds_record::vehicle_log::inventory(path).expect("an MCAP file");
        assert_eq!(tells(a), tells(b));
        assert_ne!(std::fs::read(a).expect("bytes"), std::fs::read(b).expect("bytes"), "the effect is not felt");
    }
    for (out, answer) in &runs {
        let id =
            answer.lines().find_map(|line| line.strip_prefix("id = ")).expect("an effect").trim_matches('"').to_owned();
        assert!(!out.join("recordings").exists() && !out.join("ledger.redb").exists(), "{}", out.display());
        for path in files_below(out) {
            let bytes = std::fs::read(&path).expect("bytes");
            let named = bytes.windows(id.len()).any(|window| window == id.as_bytes());
            assert!(!named, "{} names {id}", path.display());
        }
    }
}

fn files_below(folder: &std::path::Path) -> Vec<std::path::PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder").flatten() {
        if entry.path().is_dir() { found.extend(files_below(&entry.path())) } else { found.push(entry.path()) }
    }
    found
}

#[test]
fn an_effect_of_a_run_is_diagnosed_from_its_vehicle_log_and_applied() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (real, out) = (folder.path().join("world"), folder.path().join("diagnoses"));
    drive(&real, &["--effect", "gyro_bias=0.02", "--vehicle-log"]);
    let (logs, diagnoses) = (real.join("real").display().to_string(), out.display().to_string());
    let diagnosed = dreamstream(&["gap", "diagnose", &logs, "--quick", "--out", &diagnoses]).output();
    let diagnosed = diagnosed.expect("the binary runs");
    assert!(diagnosed.status.success(), "{}", String::from_utf8_lossy(&diagnosed.stderr));
    let path = out.join("world/diagnosis.json");
    let text = std::fs::read_to_string(&path).expect("a diagnosis");
    let diagnosis: Value = serde_json::from_str(&text).expect("JSON");
    assert_eq!(diagnosis["effects"][0]["id"], "gyro_bias", "{text}");
    let value = diagnosis["effects"][0]["value"].as_f64().expect("a value");
    assert!((value - 0.02).abs() < 0.004, "{value}");
    let corrected = folder.path().join("corrected.toml").display().to_string();
    let applied = dreamstream(&["gap", "apply", &path.display().to_string(), "-o", &corrected]).output();
    assert!(applied.expect("the binary runs").status.success());
    let again = folder.path().join("again");
    drive(&again, &["--config", &corrected, "--vehicle-log"]);
    assert_eq!(self::logs(&again).len(), self::logs(&real).len());

    let (real, close) = (real.display().to_string(), folder.path().join("close"));
    let kept = workspace().join("scenarios/base/free-curve.scenario.json").display().to_string();
    let out = close.display().to_string();
    let words =
        ["gap", "close", &real, &kept, "--policy", "lattice", "--observation", "layout", "--quick", "--out", &out];
    let closed = dreamstream(&words).output().expect("the binary runs");
    assert!(closed.status.success(), "{}", String::from_utf8_lossy(&closed.stderr));
    let text = std::fs::read_to_string(close.join("close.json")).expect("a comparison");
    let comparison: Value = serde_json::from_str(&text).expect("JSON");
    let deviation = comparison["closed_loop"].as_array().expect("metrics").iter();
    let deviation = deviation.clone().find(|one| one["metric"] == "route_deviation").expect("deviations of the route");
    assert!(deviation["chance"].as_f64().is_some_and(|chance| chance > 0.0), "{text}");
    assert!(std::fs::read_to_string(close.join("close.html")).is_ok_and(|page| page.contains("By chance")));
}

#[test]
fn the_next_run_is_proposed_driven_and_added_to_a_copy_of_the_case() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name).display().to_string();
    let grip =
        |plant: &mut ds_effect::Plant| (ds_effect::find("front_grip").expect("it is known").apply)(&[0.8], plant);
    ds_dynamics::synthetic::write_case(&folder.path().join("whole"), 61, &grip).expect("the case can be written");
    // ten seconds of one drive leave more than one effect open
    std::fs::create_dir(folder.path().join("short")).expect("a folder");
    let text = std::fs::read_to_string(path("whole/drive_1.csv")).expect("a table");
    let rows: Vec<&str> = text.lines().collect();
    std::fs::write(path("short/drive_1.csv"), format!("{}\n{}\n", rows[0], rows[190..391].join("\n")))
        .expect("written");
    let meta = std::fs::read_to_string(path("whole/meta.json")).expect("a description");
    let mut meta: Value = serde_json::from_str(&meta).expect("JSON");
    meta["drives"] = serde_json::json!([{ "file": "drive_1.csv" }]);
    meta.as_object_mut().expect("an object").remove("suggested_split");
    std::fs::write(path("short/meta.json"), meta.to_string()).expect("written");
    let served = format!("'{}' gap serve {{case}}", env!("CARGO_BIN_EXE_dreamstream"));
    let next = |more: &[&str], out: &str| {
        let (short, out) = (path("short"), path(out));
        let arguments = [&["gap", "next", &short, "--quick", "-o", &out], more].concat();
        let output = dreamstream(&arguments).output().expect("the binary runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = std::fs::read_to_string(path(&format!("{out}/short/next.json"))).expect("an experiment");
        (serde_json::from_str::<Value>(&text).expect("JSON"), String::from_utf8_lossy(&output.stdout).into_owned())
    };
    let (proposed, said) = next(&[], "proposed");
    assert!(proposed["planned"]["nats"].as_f64().expect("a number") > 0.05 && said.contains("drive: "), "{said}");
    let commands = std::fs::read_to_string(path("proposed/short/commands.csv")).expect("commands");
    assert!(commands.starts_with("t,cmd_steer,cmd_accel,planned_v\n") && commands.lines().count() > 300);
    assert!(std::fs::read_to_string(path("proposed/short/next.html")).expect("a page").contains("curve c1"));
    for (more, out) in
        [(&["--run", "--effect", "front_grip=0.8"][..], "own"), (&["--run", "--simulator", &served], "served")]
    {
        let (driven, said) = next(more, out);
        let runs = driven["runs"].as_array().expect("runs");
        assert!(!runs.is_empty() && runs.len() <= 5 && driven["ended"].is_string(), "{said}");
        assert!(runs.iter().all(|run| run["left_envelope"] == false), "{said}");
        let grown = std::fs::read_to_string(path(&format!("{out}/short/case/meta.json"))).expect("a case");
        let grown: Value = serde_json::from_str(&grown).expect("JSON");
        assert_eq!(grown["drives"].as_array().map(Vec::len), Some(1 + runs.len()));
        assert!(folder.path().join(out).join("short/case/run_1.csv").exists());
        if out == "own" {
            assert_eq!(runs[runs.len() - 1]["effects"], serde_json::json!(["front_grip"]), "{said}");
        }
    }
    for (limit, named) in [("tyre_share = 3.0", "tyre_share"), ("length_m = 5", "length_m"), ("width_m = 5", "width_m")]
    {
        std::fs::write(path("envelope.toml"), limit).expect("written");
        let arguments = ["gap", "next", &path("short"), "--envelope", &path("envelope.toml"), "-o", &path("no")];
        let refused = dreamstream(&arguments).output().expect("the binary runs");
        let error = String::from_utf8_lossy(&refused.stderr);
        assert!(refused.status.code() == Some(64) && error.contains(named), "{error}");
    }
}

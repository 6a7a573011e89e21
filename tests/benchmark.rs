//! `benchmark` by the real binary: shards that are killed and resumed against one undisturbed process, job arrays, and what is
//! refused.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use crate::harness::{dreamstream, signal, text, wait_for, workspace};
use serde_json::Value;

/// What every run of these tests drives: six scenarios × two policies, seeing layouts.
const WHAT: [&str; 5] = ["--policy", "constant-velocity", "route-follower", "--observation", "layout"];

fn utf8(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

fn benchmark(arguments: &[&str]) -> Command {
    dreamstream(&[&["benchmark"], arguments].concat())
}

fn said(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

/// Runs a command that must end with a code without a panic, and returns what it says.
fn ends(command: Command, code: i32) -> String {
    let told = exits(command, code);
    assert!(!told.contains("panicked"), "{told}");
    told
}

/// Runs a command that must end with a code, and returns what it says.
fn exits(mut command: Command, code: i32) -> String {
    let output = command.output().expect("the binary runs");
    assert_eq!(output.status.code(), Some(code), "{command:?}: {}", said(&output));
    said(&output)
}

/// Makes a set of six generated scenarios in a folder.
fn set(folder: &Path) -> PathBuf {
    let build = ["build", "base", "--unfiltered", "--candidates", "6", "--seed", "11", "--out"];
    ends(benchmark(&[&build[..], &[utf8(folder)]].concat()), 0);
    folder.join("town.set.json")
}

/// Returns the command that drives a shard, told by variables as a job array tells it.
fn shard(set: &Path, out: &Path, variables: &[(&str, &str)]) -> Command {
    shard_of(&WHAT, set, out, variables)
}

fn shard_of(what: &[&str], set: &Path, out: &Path, variables: &[(&str, &str)]) -> Command {
    let mut command = benchmark(&["run", utf8(set)]);
    command.args(what).args(["--shard", "auto", "--workers", "1", "--out", utf8(out)]).envs(variables.iter().copied());
    command.stdout(Stdio::null()).stderr(Stdio::piped());
    command
}

/// Returns the digest of every cell of a folder, by key; a torn last line is none.
fn cells(folder: &Path) -> BTreeMap<String, String> {
    let text_of = std::fs::read_to_string(folder.join("cells.jsonl")).unwrap_or_default();
    let whole = text_of.split_inclusive('\n').filter(|line| line.ends_with('\n'));
    let record = |line: &str| serde_json::from_str::<Value>(line).expect("a whole line is JSON");
    let records: Vec<Value> = whole.map(record).collect();
    let found: BTreeMap<_, _> = records.iter().map(|record| (text(&record["key"]), text(&record["digest"]))).collect();
    assert_eq!(found.len(), records.len(), "a cell is there twice in {}", folder.display());
    found
}

/// Waits until a process has written some cells, then ends it by a signal and returns its exit code.
fn cut(mut child: Child, out: &Path, written: usize, name: &str) -> Option<i32> {
    wait_for("an ended cell", 120, || (cells(out).len() >= written).then_some(()));
    signal(child.id(), name);
    wait_for("the end of a process", 60, || child.try_wait().expect("a child")).code()
}

#[test]
fn killed_shards_are_resumed_and_equal_one_undisturbed_process() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name);
    let set = set(folder.path());
    let whole = path("whole");
    let mut command = benchmark(&["run", utf8(&set)]);
    command.args(WHAT).args(["--workers", "2", "--out", utf8(&whole)]);
    ends(command, 0);
    assert_eq!(cells(&whole).len(), 12);

    let slurm = |index| [("SLURM_ARRAY_TASK_ID", index), ("SLURM_ARRAY_TASK_COUNT", "3")];
    let kubernetes = [("JOB_COMPLETION_INDEX", "2"), ("DREAMSTREAM_SHARDS", "3")];
    let parts = ["0", "1", "2"].map(path);
    let first = shard(&set, &parts[0], &slurm("0")).spawn().expect("it starts");
    let second = shard(&set, &parts[1], &slurm("1")).spawn().expect("it starts");
    assert_eq!(cut(first, &parts[0], 1, "KILL"), None);
    assert_eq!(cut(second, &parts[1], 2, "TERM"), Some(130));
    let lost = cells(&parts[0]).len();
    assert!(lost < 4, "the first shard was over before it was killed");
    let merged = path("early");
    let told = ends(benchmark(&["merge", utf8(&parts[0]), utf8(&parts[1]), "-o", utf8(&merged)]), 1);
    assert!(told.contains("missing: "), "{told}");

    // A line that was being written when the power failed.
    let file = parts[0].join("cells.jsonl");
    let torn = std::fs::read_to_string(&file).expect("cells") + "{\"key\":\"0";
    std::fs::write(&file, torn).expect("written");
    let told = ends(benchmark(&["resume", utf8(&parts[0])]), 0);
    assert!(told.contains("torn last line") && told.contains("cells.jsonl"), "{told}");
    ends(benchmark(&["resume", utf8(&parts[1])]), 0);
    ends(shard(&set, &parts[2], &kubernetes), 0);
    ends(benchmark(&["resume", utf8(&parts[2])]), 0);
    for (k, order) in [[0, 1, 2], [2, 0, 1]].into_iter().enumerate() {
        let merged = path(&format!("merged{k}"));
        let folders = order.map(|index| utf8(&parts[index]));
        let told = ends(benchmark(&[&["merge"], &folders[..], &["-o", utf8(&merged)]].concat()), 0);
        assert!(told.contains("12 of 12 cells ended"), "{told}");
        assert_eq!(cells(&merged), cells(&whole));
    }
    let merged = path("merged0");
    ends(benchmark(&["report", utf8(&merged)]), 0);
    let read = |name: &str| std::fs::read_to_string(merged.join(name)).expect("a file of the report");
    let report: Value = serde_json::from_str(&read("report.json")).expect("JSON");
    let rows = report["tables"]["policies"]["rows"].as_array().expect("rows");
    assert_eq!((&report["complete"], rows.len()), (&Value::Bool(true), 4));
    let score = |row: &Value| row["DS"]["value"].as_f64().expect("a score");
    let low = |row: &Value| row["DS"]["interval"][0].as_f64().expect("an interval");
    assert!(rows.iter().all(|row| (0.0..=1.0).contains(&score(row)) && low(row) <= score(row)), "{rows:?}");
    for part in ["route-follower (anchor)", "DrivoR", "Outcomes by drive", "town"] {
        assert!(read("report.html").contains(part) && read("report.md").contains(part), "{part} is missing");
    }
    let faults = report["tables"]["faults"]["rows"].as_array().expect("rows");
    let count = |what: &str| faults.iter().find(|row| row["what"] == what).map(|row| row["count"].clone());
    assert_eq!(count("sessions that were killed"), Some(1.into()));
    assert_eq!(count("sessions that a signal ended"), Some(1.into()));
    assert_eq!(count("sessions that found a torn last line"), Some(1.into()));
    let told = ends(benchmark(&["report", utf8(&path("early"))]), 1);
    assert!(told.contains("Incomplete") && !told.contains("Outcomes"), "{told}");
}

#[test]
fn a_task_of_a_slurm_array_is_queued_again_and_goes_on() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (set, out) = (set(folder.path()), folder.path().join("out"));
    // Stands for the scheduler: writes down what it is asked.
    let scheduler = folder.path().join("scontrol");
    std::fs::write(&scheduler, "#!/bin/sh\necho \"$@\" >> \"$0.asked\"\n").expect("written");
    succeeds(&["chmod", "+x", utf8(&scheduler)]);
    let path = format!("{}:{}", utf8(folder.path()), std::env::var_os("PATH").unwrap_or_default().display());
    let task = || {
        let mut command = Command::new("bash");
        let script = crate::harness::workspace().join("deploy/benchmark/slurm.sh");
        command.arg(script).args([utf8(&set), "constant-velocity", "--observation", "layout"]).env("PATH", &path);
        command.env("DREAMSTREAM_BIN", env!("CARGO_BIN_EXE_dreamstream")).env("DREAMSTREAM_OUT", &out);
        let variables = [("TASK_ID", "1"), ("TASK_COUNT", "2"), ("JOB_ID", "77")];
        command.envs(variables.map(|(name, value)| (format!("SLURM_ARRAY_{name}"), value)));
        command.env("SLURM_CPUS_PER_TASK", "1").current_dir(crate::harness::workspace());
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        command
    };
    let first = task().spawn().expect("it starts");
    assert_eq!(cut(first, &out.join("1"), 1, "TERM"), Some(130));
    let asked = std::fs::read_to_string(folder.path().join("scontrol.asked")).expect("the scheduler was asked");
    assert_eq!(asked, "requeue 77_1\n");
    assert_eq!(task().status().expect("it runs").code(), Some(0));
    assert_eq!(cells(&out.join("1")).len(), 3);
    // What is left after six times is not queued for ever.
    let left = task().env("DREAMSTREAM_BIN", "false").env("SLURM_RESTART_COUNT", "6").status().expect("it runs");
    let asked = std::fs::read_to_string(folder.path().join("scontrol.asked")).expect("the scheduler was asked");
    assert_eq!((left.code(), asked.as_str()), (Some(1), "requeue 77_1\n"));
}

/// Runs a command that must succeed.
fn succeeds(command: &[&str]) {
    let status = Command::new(command[0]).args(&command[1..]).status().expect("it runs");
    assert!(status.success(), "{command:?}");
}

#[test]
fn a_filtered_set_is_all_that_lies_there_under_the_name_of_a_set() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let build = ["build", "base", "--candidates", "8", "--seed", "20000", "--out", utf8(folder.path())];
    let told = ends(benchmark(&build), 0);
    assert!(told.contains("solved_by_constant_velocity"), "{told}");
    let files = std::fs::read_dir(folder.path()).expect("a folder").map(|file| file.expect("a file").file_name());
    let sets: Vec<_> = files.filter(|name| name.to_string_lossy().ends_with(".set.json")).collect();
    assert_eq!(sets, ["town.set.json"]);
}

#[test]
fn scenarios_of_one_recording_are_driven_as_one_log() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (logs, sets, out) = (folder.path().join("logs"), folder.path().join("sets"), folder.path().join("out"));
    let read = |path: &Path| std::fs::read_to_string(path).expect("it is there");
    let made = workspace().join("crates/drive/import/tests/data/crossing.commonroad.xml");
    for ego in [&[][..], &["--ego", "501"]] {
        let import = ["import", "commonroad", utf8(&made), "-o", utf8(&logs)];
        ends(dreamstream(&[&import[..], ego].concat()), 0);
    }
    ends(benchmark(&["build", "base", utf8(&logs), "--unfiltered", "--out", utf8(&sets)]), 0);
    let set = sets.join("logs.set.json");
    let entries = serde_json::from_str::<Value>(&read(&set)).expect("JSON")["entries"].clone();
    let told = |key: &str| -> Vec<Value> {
        entries.as_array().expect("a list").iter().map(|entry| entry[key].clone()).collect()
    };
    assert_eq!(told("log"), ["ZAM_Crossing-1_1_T-1"; 2]);
    assert_eq!(told("last"), [80, 70]);
    ends(benchmark(&[&["run", utf8(&set), "--out", utf8(&out)], &WHAT[..]].concat()), 0);
    ends(benchmark(&["report", utf8(&out)]), 0);
    let row =
        read(&out.join("report.md")).lines().find(|line| line.starts_with("| constant-velocity")).map(str::to_owned);
    assert!(row.as_ref().is_some_and(|row| row.ends_with("| 2 | 1 | 0 | 0 |")), "{row:?}");
}

#[test]
fn the_thirteen_conditions_of_a_base_set_are_driven_and_compared() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (set, out) = (set(folder.path()), folder.path().join("out"));
    let weather = ["build", "weather", utf8(&set), "--every", "6", "--out", utf8(folder.path())];
    ends(benchmark(&weather), 0);
    let weather = folder.path().join("town-weather.set.json");
    let what = ["--policy", "constant-velocity", "--observation", "layout"];
    let plan = ends(benchmark(&[&["plan", utf8(&set), utf8(&weather)], &what[..]].concat()), 0);
    assert!(plan.contains("19 cells"), "{plan}");
    let run = |endpoints: &str| {
        let told = ["--endpoints", endpoints, "--out", utf8(&out)];
        benchmark(&[&["run", utf8(&set), utf8(&weather)], &what[..], &told].concat())
    };
    let told = ends(run("configs/benchmark/plan.toml"), 2);
    assert!(told.contains("\"camera\"") && told.contains("not driven") && !out.exists(), "{told}");
    let declared = folder.path().join("plan.toml");
    let axes = "kind = 'axes'\npolicy = 'constant-velocity'\nfirst = 'weather'\nsecond = 'surface'";
    let text_of = format!("version = 1\n[[endpoint]]\nname = 'a'\nprofile = 'strict'\ndirection = 'down'\n{axes}\n");
    std::fs::write(&declared, text_of).expect("written");
    ends(run(utf8(&declared)), 0);
    ends(benchmark(&["report", utf8(&out)]), 0);
    let report = std::fs::read_to_string(out.join("report.json")).expect("a report");
    let report: Value = serde_json::from_str(&report).expect("JSON");
    let rows = report["tables"]["weather"]["rows"].as_array().expect("rows");
    let endpoints = report["tables"]["endpoints"]["rows"].as_array().expect("rows");
    assert!(endpoints.len() == 1 && endpoints[0]["conclusion"] == "not tested", "{endpoints:?}");
    // Thirteen conditions and three means, in two profiles; who drives blind drives alike in all of them.
    assert_eq!(rows.len(), 32);
    assert!(rows.iter().all(|row| row["difference"]["value"] == 0.0 && row["p"].is_null()), "{}", rows[0]);
    let blind = "condition not shown: this source has no look";
    assert!(rows.iter().all(|row| row["verdict"] == blind), "{}", rows[0]);
}

#[test]
fn what_generated_frames_show_of_a_condition_gates_its_rows() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name);
    let build = ["build", "base", "--unfiltered", "--candidates", "1", "--seed", "11", "--out", utf8(folder.path())];
    ends(benchmark(&build), 0);
    let [base, weather, out] = ["town.set.json", "town-weather.set.json", "out"].map(path);
    ends(benchmark(&["build", "weather", utf8(&base), "--out", utf8(folder.path())]), 0);
    let what = ["--policy", "constant-velocity", "--observation", "dreamstream", "reference", "--out", utf8(&out)];
    ends(benchmark(&[&["run", utf8(&base), utf8(&weather)], &what[..]].concat()), 0);
    ends(benchmark(&["report", utf8(&out)]), 0);
    let report = std::fs::read_to_string(out.join("report.json")).expect("a report");
    let report: Value = serde_json::from_str(&report).expect("JSON");
    let rows = |table: &str| report["tables"][table]["rows"].as_array().expect("rows").clone();
    let shown = rows("shown");
    assert_eq!(shown.len(), 13);
    assert!(shown.iter().all(|row| row["source"] == "dreamstream" && row["frames"] == 1), "{shown:?}");
    let gates: BTreeMap<String, String> =
        shown.iter().map(|row| (text(&row["condition"]), text(&row["gate"]))).collect();
    for row in rows("weather").iter().filter(|row| row["condition"] != "mean") {
        let gate = &gates[&text(&row["condition"])];
        let objected = text(&row["verdict"]) == "condition not shown";
        let generated = text(&row["how"]).starts_with("dreamstream");
        assert_eq!(objected, generated && gate == "condition not shown", "{row}");
    }
    let parts = rows("conditions");
    assert_eq!(parts.len(), 2 * 2 * 16);
    // Who looks at nothing drives alike under every condition, so no part of the score changes.
    assert!(parts.iter().all(|row| row["NC"]["value"] == 0.0 && row["RC"]["value"] == 0.0), "{}", parts[0]);
}

#[test]
fn a_set_with_adversaries_is_the_same_again_and_its_solutions_are_driven_again() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let set = set(folder.path());
    let build = |out: &str| {
        let out = folder.path().join(out);
        ends(benchmark(&["build", "behavior", utf8(&set), "--every", "2", "--out", utf8(&out)]), 0);
        out.join("town-behavior.set.json")
    };
    let (one, other) = (build("one"), build("other"));
    let read = |path: &Path| std::fs::read_to_string(path).expect("a file");
    assert_eq!(read(&one), read(&other));
    let beside = one.parent().expect("a folder");
    let more = ["build", "behavior", utf8(&set), "--every", "2", "--mode", "replay", "--out", utf8(beside)];
    let told = ends(benchmark(&more), 2);
    assert!(told.contains("town-behavior.set.json") && told.contains("stays"), "{told}");
    ends(benchmark(&[&more[..], &["--name", "replay"]].concat()), 0);
    let replay = beside.join("replay.set.json");
    let told = ends(benchmark(&["check", utf8(&one)]), 0);
    assert!(told.contains("every solution was driven again"), "{told}");

    let manifest: Value = serde_json::from_str(&read(&one)).expect("JSON");
    let entries = manifest["entries"].as_array().expect("entries");
    let bases: Vec<String> = entries.iter().map(|entry| text(&entry["base"])).collect();
    assert!(!bases.is_empty() && bases.windows(2).all(|pair| pair[0] < pair[1]), "one for each base: {bases:?}");
    let entry = &entries[0];
    assert_eq!(text(&entry["name"]), format!("{}__{}", bases[0], text(&entry["category"])));

    let out = folder.path().join("driven");
    let claim =
        "[[endpoint]]\nname = 'a'\nprofile = 'strict'\ndirection = 'up'\nkind = 'contacts'\npolicy = 'route-follower'";
    let declared = folder.path().join("plan.toml");
    let text_of = format!("version = 1\n{claim}\nfirst = 'replay'\nsecond = 'town-behavior'\n");
    std::fs::write(&declared, text_of).expect("written");
    let told = ["--endpoints", utf8(&declared), "--out", utf8(&out)];
    let driven = [&[utf8(&set), utf8(&one), utf8(&replay)], &WHAT[..]].concat();
    ends(benchmark(&[&["run"], &driven[..], &told].concat()), 0);
    let told = ends(benchmark(&[&["plan"], &driven[..], &["--done", utf8(&out)]].concat()), 0);
    assert!(told.contains("all shards: 0 of ") && told.contains("the measured rate"), "{told}");
    let told = ends(benchmark(&["plan", utf8(&set), "--policy", "careful", "--done", utf8(&out)]), 2);
    assert!(told.contains("cells.jsonl") && told.contains("no cell of this benchmark"), "{told}");
    let replayed: Value = serde_json::from_str(&read(&replay)).expect("JSON");
    let all = entries.len() + replayed["entries"].as_array().expect("entries").len();
    assert_eq!(cells(&out).len(), 2 * (6 + all), "variants of one name in two modes are driven together");
    ends(benchmark(&["report", utf8(&out)]), 0);
    let report: Value = serde_json::from_str(&read(&out.join("report.json"))).expect("JSON");
    let figures = report["tables"]["quality"]["rows"].as_array().expect("figures of the search");
    let solved = figures.iter().find(|row| row["measure"] == "variants that an expert solves").expect("a bar");
    assert!(solved["met"] == "met" && solved["figure"]["value"] == 1.0, "{solved}");
    let margins = report["tables"]["margins"]["rows"].as_array().expect("rows by reaction margin");
    let counted: u64 = margins.iter().map(|row| row["variants"].as_u64().expect("a count")).sum();
    assert_eq!(counted, 2 * all as u64, "every variant has a margin, for each of two policies");
    let paired = &report["tables"]["endpoints"]["rows"][0];
    assert!(paired["scenarios"].as_u64() > Some(0) && paired["second"]["value"].is_number(), "{paired}");
    falls_are_driven_again(&out, &report);

    let solution = other.with_file_name(text(&entry["file"]).replace(".scenario.json", ".solution.json"));
    let mut value: Value = serde_json::from_str(&read(&solution)).expect("JSON");
    value["x_m"][3] = 0.into();
    std::fs::write(&solution, value.to_string()).expect("written");
    let told = ends(benchmark(&["check", utf8(&other)]), 2);
    assert!(told.contains(&text(&entry["name"])) && told.contains(".solution.json"), "{told}");
    let told = ends(benchmark(&["build", "behavior", utf8(&one), "--out", utf8(folder.path())]), 2);
    assert!(told.contains("not base"), "{told}");
}

/// Runs the commands that a report tells: its worst falls are then animated, the base beside the variant.
fn falls_are_driven_again(out: &Path, report: &Value) {
    let page = || std::fs::read_to_string(out.join("report.html")).expect("a page");
    let again = report["tables"]["again"]["rows"].as_array().expect("drives without a recording");
    assert!(again.len() >= 3 && !page().contains("<img"), "{again:?}");
    for row in again {
        let command = text(&row["command"]);
        let words: Vec<&str> = command.split(' ').collect();
        assert_eq!(words[..2], ["dreamstream", "benchmark"], "{command}");
        let told = ends(benchmark(&words[2..]), 0);
        assert!(told.contains("shard ") || told.contains("report: "), "{told}");
    }
    let told: Value = serde_json::from_slice(&std::fs::read(out.join("report.json")).expect("there")).expect("JSON");
    let falls = told["tables"]["falls"]["rows"].as_array().expect("falls");
    assert!(falls.iter().all(|row| row["animations"] == "below") && told["tables"]["again"].is_null(), "{falls:?}");
    assert_eq!(page().matches("<img").count(), 2 * falls.len());
    let animations =
        std::fs::read_dir(out.join("falls")).expect("a folder").map(|entry| entry.expect("an entry").path());
    assert!(animations.filter(|path| path.extension().is_some_and(|end| end == "gif")).count() + 1 == again.len());
    // A run that ended otherwise is no drive of this benchmark's.
    let folder = out.join("falls").join("other");
    std::fs::create_dir_all(&folder).expect("made");
    let record = std::fs::read_to_string(out.join("cells.jsonl")).expect("cells");
    std::fs::write(folder.join("cells.jsonl"), record.replacen("\"digest\":\"", "\"digest\":\"0", 1)).expect("written");
    let told = ends(benchmark(&["report", utf8(out), "--recordings", utf8(&folder)]), 2);
    assert!(told.contains("line 1") && told.contains("digest"), "{told}");
}

#[test]
fn states_that_are_kept_score_as_the_whole_recording_does() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let set = set(folder.path());
    let drive = |keep: &str| {
        let out = folder.path().join(keep);
        ends(benchmark(&[&["run", utf8(&set)], &WHAT[..], &["--keep", keep, "--out", utf8(&out)]].concat()), 0);
        let lines = std::fs::read_to_string(out.join("cells.jsonl")).expect("cells");
        let record = |line: &str| serde_json::from_str::<Value>(line).expect("a whole line is JSON");
        let path = |record: &Value| out.join(text(&record["episode"]["recording"]));
        let records = lines.lines().map(record);
        let found: BTreeMap<String, PathBuf> = records.map(|record| (text(&record["key"]), path(&record))).collect();
        (cells(&out), found)
    };
    let ((whole, all), (thin, states)) = (drive("all"), drive("states"));
    assert_eq!((whole.len(), &whole), (12, &thin));
    for (key, path) in &states {
        let (size, of) = (|path: &Path| std::fs::metadata(path).expect("a recording").len(), &all[key]);
        assert!(size(path) < size(of), "{} is not smaller than {}", path.display(), of.display());
        let score = |path: &Path| {
            let file = folder.path().join("score.json");
            ends(dreamstream(&["score", utf8(path), "--out", utf8(&file)]), 0);
            let told = std::fs::read_to_string(&file).expect("scores");
            told.replace(utf8(path), "")
        };
        assert_eq!(score(path), score(of));
    }
    let (_, path) = states.first_key_value().expect("a drive");
    let told = ends(dreamstream(&["replay", utf8(path), "--service", "vdm-worker"]), 1);
    assert!(told.contains("advance"), "what it lacks is named: {told}");
}

#[test]
fn values_that_cannot_be_meant_are_refused_before_anything_is_driven() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name);
    let (mine, files) = set_of_files(folder.path());
    let (out, empty) = (path("out"), path("empty.txt"));
    std::fs::write(&empty, "# nobody\n").expect("written");
    let taken = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = taken.local_addr().expect("an address").to_string();
    let (file, set, to) = (utf8(&files[0]), utf8(&mine), utf8(&out));
    let blind = "constant-velocity";
    let run = ["run", set, "--policy", blind, "--observation", "layout", "--out", to];
    let plan = ["plan", set, "--policy"];
    let check = |arguments: &[&str], code: i32, says: &str| {
        let told = ends(benchmark(arguments), code);
        assert!(told.contains(says), "{arguments:?}: {told}");
        assert!(!out.exists(), "{arguments:?} left files");
    };
    check(&["build", "base", "--candidates", "16", "--seed", "18446744073709551615", "--out", to], 64, "--seed");
    check(&["build", "base", "--unfiltered", "--name", "a/b", "--out", to], 2, "\"a/b\"");
    check(&["build", "base", "--unfiltered", "--name", "", "--out", to], 2, "\"name\"");
    check(&["build", "base", "--names", utf8(&empty), "--out", to], 64, "--names");
    check(&["build", "base", file, "--seed", "1", "--out", to], 64, "--seed");
    check(&["build", "base", file, "--names", utf8(&empty), "--out", to], 2, "empty.txt");
    check(&["build", "base", file, file, "--unfiltered", "--out", to], 2, "entries[1].name");
    check(&[&plan[..], &["nobody"]].concat(), 2, "\"nobody\"");
    check(&[&plan[..], &[blind, blind]].concat(), 2, "policy constant-velocity is named twice");
    check(&[&plan[..], &[blind, "--rate", "0"]].concat(), 64, "--rate");
    check(&[&plan[..], &[blind, "--rate", "nan"]].concat(), 64, "--rate");
    check(&[&plan[..], &[blind, "--model", "no/such.toml"]].concat(), 2, "no/such.toml");
    check(&[&run[..], &["--workers", "0"]].concat(), 64, "--workers");
    check(&[&run[..], &["--model", "no/such.toml"]].concat(), 2, "no/such.toml");
    check(&[&run[..], &["--metrics", &address]].concat(), 2, &address);
    let adverse = |more: &[&str], code: i32| {
        ends(dreamstream(&[&["scenario", "adverse", file, "--out", utf8(folder.path())], more].concat()), code)
    };
    assert!(adverse(&["--hand-over", "4294967295"], 64).contains("--hand-over"));
    std::fs::write(path("adverse.json"), "{}").expect("written");
    assert!(adverse(&[], 1).contains("adverse.json"));
}

/// Changes a manifest and returns its path beside the sound one.
fn changed(set: &Path, change: impl FnOnce(&mut Value)) -> PathBuf {
    let mut value: Value = serde_json::from_slice(&std::fs::read(set).expect("a manifest")).expect("JSON");
    change(&mut value);
    let path = set.with_file_name("changed.set.json");
    std::fs::write(&path, value.to_string()).expect("written");
    path
}

#[test]
fn what_cannot_be_meant_is_refused_by_name_and_nothing_is_overwritten() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let set = set(folder.path());
    let out = folder.path().join("out");
    let run = |set: &Path| {
        let mut command = benchmark(&["run", utf8(set)]);
        command.args(WHAT).args(["--out", utf8(&out)]);
        command
    };
    let digest = changed(&set, |value| value["entries"][0]["category"] = "other".into());
    let told = ends(run(&digest), 2);
    assert!(told.contains("changed.set.json") && told.contains("\"digest\""), "{told}");
    let licence = changed(&set, |value| value["entries"][0]["licence"] = "CC-BY-NC-SA-4.0".into());
    let told = ends(benchmark(&["check", utf8(&licence)]), 2);
    assert!(told.contains("\"licence\"") && told.contains("strictest"), "{told}");
    let told = ends(run(&folder.path().join("absent.set.json")), 2);
    assert!(told.contains("absent.set.json"), "{told}");
    let told = ends(benchmark(&["run", utf8(&set), "--policy", "nobody", "--out", utf8(&out)]), 2);
    assert!(told.contains("\"nobody\"") && told.contains("lattice"), "{told}");
    let mut weights = benchmark(&["run", utf8(&set), "--policy", "drivor", "--out", utf8(&out)]);
    weights.args(["--policy-weights", "no/such.safetensors"]);
    assert!(ends(weights, 2).contains("no/panel/drivor.safetensors"), "cells are keyed by the policy's own weights");
    let mut alone = run(&set);
    alone.args(["--shard", "auto"]).env_remove("SLURM_ARRAY_TASK_ID").env_remove("JOB_COMPLETION_INDEX");
    assert!(ends(alone, 2).contains("SLURM_ARRAY_TASK_ID"));
    assert!(!out.exists(), "a refused benchmark left files");
    ends(benchmark(&["check", utf8(&set)]), 0);

    ends(benchmark(&["check", "configs/benchmark/town.set.json"]), 0);
    let mut lost = set_of_files(folder.path());
    std::fs::remove_file(lost.1.pop().expect("a file")).expect("removed");
    let told = ends(benchmark(&["check", utf8(&lost.0)]), 2);
    assert!(told.contains("cannot read") && told.contains(".scenario.json"), "{told}");

    let there = std::fs::read(&set).expect("a manifest");
    let other = ["build", "base", "--unfiltered", "--candidates", "7", "--out", utf8(folder.path())];
    let told = ends(benchmark(&other), 2);
    assert!(told.contains("town.set.json") && told.contains("stays"), "{told}");
    assert_eq!(std::fs::read(&set).expect("a manifest"), there);
}

/// Returns the rows of a measurement of scale, and its warnings.
fn scaled(arguments: &[&str], out: &Path) -> (Vec<Value>, String) {
    let scenarios = ["free-curve", "cut-in"].map(|name| format!("scenarios/base/{name}.scenario.json"));
    let mut command = benchmark(&["scale", &scenarios[0], &scenarios[1], "--duration", "1", "--out", utf8(out)]);
    command.args(arguments);
    ends(command, 0);
    let report = std::fs::read_to_string(out.join("report.json")).expect("a report");
    let report: Value = serde_json::from_str(&report).expect("JSON");
    (report["tables"]["scaling"]["rows"].as_array().expect("rows").clone(), report["warnings"].to_string())
}

#[test]
fn a_worker_is_killed_while_scale_is_measured_and_nothing_is_lost_or_different() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("simulated");
    // Eight drives of two iterations of two chunks, two at a time: 16 s. One kill late, and time for its lease to end and its
    // drive to go on before the next, for two kills of one drive are its end.
    let what = ["--workers", "2", "--episodes", "8", "--simulated", "1", "--kill-every", "14"];
    let (rows, warnings) = scaled(&what, &out);
    let count = |row: &Value, name: &str| row[name].as_u64().expect("a count");
    assert_eq!((count(&rows[0], "workers"), count(&rows[0], "episodes")), (2, 8));
    assert!(count(&rows[0], "killed") >= 1, "{rows:?}");
    assert_eq!([count(&rows[0], "lost"), count(&rows[0], "different")], [0, 0]);
    // Two seconds an iteration; the part of a drive that another worker takes over may cost less.
    assert!(rows[0]["generation ms"].as_f64().is_some_and(|ms| ms > 1_000.0), "{rows:?}");
    assert!(rows[0]["commits/s"].as_f64().is_some_and(|rate| rate > 0.0), "{rows:?}");
    assert!(warnings.contains("Simulated") && !out.join("fleets").join("2").exists(), "{warnings}");

    let out = folder.path().join("real");
    let (rows, warnings) = scaled(&["--workers", "1", "--episodes", "2"], &out);
    assert_eq!([count(&rows[0], "lost"), count(&rows[0], "different"), count(&rows[0], "killed")], [0; 3]);
    assert!(rows[0]["efficiency %"] == 1.0 && warnings == "[]", "{rows:?} {warnings}");
    let told = ends(benchmark(&["scale", "--workers", "2,1,2", "--out", utf8(&out)]), 2);
    assert!(told.contains("names 2 twice"), "{told}");
}

/// Makes a set of two scenario files and returns it with the files.
fn set_of_files(folder: &Path) -> (PathBuf, Vec<PathBuf>) {
    let generate = ["scenario", "generate", "--family", "cut-in", "--count", "2", "--out"];
    let files = folder.join("files");
    ends(dreamstream(&[&generate[..], &[utf8(&files)]].concat()), 0);
    ends(benchmark(&["build", "base", utf8(&files), "--unfiltered", "--name", "mine", "--out", utf8(folder)]), 0);
    let files = ["cut-in-0", "cut-in-1"].map(|name| files.join(format!("{name}.scenario.json")));
    (folder.join("mine.set.json"), files.to_vec())
}

#[test]
fn one_writer_at_a_time_and_a_full_disk_loses_nothing() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let set = set(folder.path());
    let out = folder.path().join("out");
    let variables = [("JOB_COMPLETION_INDEX", "0"), ("DREAMSTREAM_SHARDS", "6")];
    let what = ["--policy", "constant-velocity", "route-follower", "--observation", "reference"];
    // Less than a recording takes, more than the ledger takes when it is made.
    let mut limited = Command::new("sh");
    let run = shard_of(&what, &set, &out, &variables);
    limited
        .args(["-c", "trap '' XFSZ; ulimit -f 5000; exec \"$0\" \"$@\""])
        .arg(run.get_program())
        .args(run.get_args());
    limited.current_dir(crate::harness::workspace()).stdin(Stdio::null());
    limited.envs(variables);
    // The bus may complain of its own end when a fleet is taken down at once.
    let told = exits(limited, 2);
    assert!(told.contains("storage failed"), "{told}");
    let before = cells(&out);

    let mut first = benchmark(&["resume", utf8(&out)]).stdout(Stdio::null()).spawn().expect("it starts");
    let lock =
        || std::fs::read_to_string(out.join("run.lock")).ok().filter(|text| text.trim() == first.id().to_string());
    wait_for("the lock", 60, lock);
    let told = ends(benchmark(&["resume", utf8(&out)]), 2);
    assert!(told.contains("in use by another run"), "{told}");
    assert!(first.wait().expect("it ends").success());
    let after = cells(&out);
    assert_eq!(after.len(), 2);
    assert!(before.iter().all(|(key, digest)| after.get(key) == Some(digest)));
    let told = ends(shard(&set, &out, &variables), 2);
    assert!(told.contains("benchmark resume"), "{told}");
    assert_eq!(cells(&out), after);

    // A line that was lost after its recording was deleted: the ledger has the drive, and nothing is left to judge it by.
    let file = out.join("cells.jsonl");
    let lines = std::fs::read_to_string(&file).expect("cells");
    std::fs::write(&file, lines.split_inclusive('\n').next().expect("a line")).expect("written");
    let told = ends(benchmark(&["resume", utf8(&out)]), 1);
    assert!(told.contains("1 cells were aborted"), "{told}");
    ends(benchmark(&["resume", utf8(&out)]), 0);
    let merged = folder.path().join("merged");
    ends(benchmark(&["merge", utf8(&out), "-o", utf8(&merged)]), 1);
    assert_eq!(cells(&merged), after);

    // As if program, weights or model had changed since.
    let sheet = out.join("benchmark.json");
    let value: Value = serde_json::from_slice(&std::fs::read(&sheet).expect("a sheet")).expect("JSON");
    for (part, place) in
        [("program", "/program"), ("policies", "/policies/0/digest"), ("observations", "/observations/0/digest")]
    {
        let mut value = value.clone();
        *value.pointer_mut(place).expect("a part of the sheet") = "was".into();
        std::fs::write(&sheet, value.to_string()).expect("written");
        let told = ends(benchmark(&["resume", utf8(&out)]), 2);
        assert!(told.contains(&format!("{part} differ")) && told.contains("was"), "{told}");
    }
}

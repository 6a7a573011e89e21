//! Nothing is lost and nothing silently wrong: damaged recordings, a full disk, two runs in one folder, a policy that is not
//! there, a reader who leaves.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::LazyLock;

use crate::harness::{Drive, command, dreamstream, drive, finished, start, wait_for};
use ds_space::Draws;
use serde_json::Value;

const SCENARIO: &str = "scenarios/base/free-curve.scenario.json";
/// Exit code where nothing more can be stored.
const STORAGE: i32 = 74;

/// What results tell of a drive's states and pictures, in the order of [`Drive::digests`].
const DIGESTS: [&str; 3] = ["world_digest", "layout_digest", "frame_digest"];

/// A sound drive with its vehicle log.
const LOGGED: [&str; 2] = [SCENARIO, "--vehicle-log"];
static WHOLE: LazyLock<Drive> = LazyLock::new(|| drive(&LOGGED));

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn run(arguments: &[&str]) -> Output {
    dreamstream(arguments).output().expect("the binary runs")
}

/// Runs a command that must be refused, and returns what it says.
fn refused(arguments: &[&str], code: i32) -> String {
    let output = run(arguments);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {}", stderr(&output));
    assert!(!stderr(&output).contains("panicked"), "{arguments:?}: {}", stderr(&output));
    stderr(&output)
}

fn utf8(path: &Path) -> &str {
    path.to_str().expect("UTF-8")
}

/// Copies a run's folder with one byte of its recording changed, or its end cut off.
fn damaged(folder: &Path, damage: impl FnOnce(&mut Vec<u8>)) -> PathBuf {
    let whole = WHOLE.recording(0);
    let name = whole.file_name().expect("a name");
    let path = folder.join("recordings").join(name);
    std::fs::create_dir_all(folder.join("recordings")).expect("a folder");
    std::fs::copy(WHOLE.folder.path().join("results.json"), folder.join("results.json")).expect("copied");
    let mut bytes = std::fs::read(&whole).expect("the recording");
    damage(&mut bytes);
    std::fs::write(&path, bytes).expect("written");
    path
}

#[test]
fn a_recording_that_was_not_finished_is_refused_and_one_that_is_gone_is_told() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = damaged(folder.path(), |_| {});
    let out = folder.path().join("page");
    let report = ["report", utf8(folder.path()), "--out", utf8(&out)];
    let unfinished = PathBuf::from(format!("{}.partial", path.display()));
    std::fs::rename(&path, &unfinished).expect("renamed");
    let says = refused(&report, 1);
    assert!(says.contains("unfinished") && says.contains("--partial"), "{says}");
    std::fs::remove_file(&unfinished).expect("removed");
    let output = run(&report);
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(stderr(&output).contains("1 of 1 recordings are not there"), "{}", stderr(&output));
}

#[test]
fn damaged_recordings_are_refused_and_partial_answers_say_so() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let draws = Draws::from_seed(1, "damage");
    let flip = |index: u64| {
        move |bytes: &mut Vec<u8>| {
            let at = draws.below(index, bytes.len() as u64) as usize;
            bytes[at] ^= 1 << draws.below(index + 100, 8);
        }
    };
    for index in 0..12 {
        let path = damaged(folder.path(), flip(index));
        let says = refused(&["score", utf8(&path)], 1);
        assert!(
            ["damaged or incomplete", "damaged before its scene ends", "not a recording"]
                .iter()
                .any(|word| says.contains(word)),
            "{says}"
        );
    }
    let path = damaged(folder.path(), |bytes| bytes.truncate(bytes.len() / 2));
    let (recording, out) = (utf8(&path), folder.path().join("out"));
    let (scores, page) = (folder.path().join("scores.json"), folder.path().join("page"));
    let rrd = folder.path().join("drive.rrd");
    let view = ["view", recording, "--save", utf8(&rrd)];
    let commands: [&[&str]; 3] = [
        &["score", recording, "--out", utf8(&scores)],
        &["replay", recording, "--service", "sim-server"],
        &["report", utf8(folder.path()), "--out", utf8(&page)],
    ];
    let says = refused(&view, 1);
    assert!(says.contains("damaged or incomplete") && says.contains("--partial"), "{says}");
    for arguments in commands {
        let says = refused(arguments, 1);
        for part in ["damaged or incomplete", "byte ", "frame/front: ", "missing", "--partial"] {
            assert!(says.contains(part), "{arguments:?} does not say {part:?}: {says}");
        }
        let output = run(&[arguments, &["--partial"]].concat());
        assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
        assert!(stdout(&output).contains("partial: "), "{arguments:?} does not say so: {}", stdout(&output));
    }
    let read = |path: &Path| std::fs::read_to_string(path).expect("a text");
    let scores: Value = serde_json::from_str(&read(&scores)).expect("JSON");
    assert!(scores[0]["partial"].as_str().is_some_and(|says| says.contains("missing")), "{scores}");
    let report: Value = serde_json::from_str(&read(&page.join("report.json"))).expect("JSON");
    assert!(report["partial"][0].as_str().is_some_and(|says| says.contains("missing")), "{}", report["partial"]);
    assert!(read(&page.join("report.html")).contains("damaged or incomplete"));
    assert!(!out.exists());

    let real = folder.path().join("real");
    std::fs::create_dir_all(&real).expect("a folder");
    for entry in std::fs::read_dir(WHOLE.folder.path().join("real")).expect("vehicle logs").flatten() {
        let mut bytes = std::fs::read(entry.path()).expect("a log");
        if entry.path().extension().is_some_and(|kind| kind == "mcap") {
            let middle = bytes.len() / 2;
            bytes[middle] ^= 4;
        }
        std::fs::write(real.join(entry.file_name()), bytes).expect("written");
    }
    let says = refused(&["gap", "diagnose", utf8(&real), "--quick", "--out", utf8(&out)], 1);
    assert!(says.contains("damaged or incomplete"), "{says}");
}

/// Runs a drive whose files may not grow beyond a number of bytes.
fn limited(arguments: &[&str], out: &Path, bytes: u64) -> Output {
    let drive = command(arguments, out);
    let mut shell = Command::new("sh");
    let script = format!("trap '' XFSZ; ulimit -f {}; exec \"$0\" \"$@\"", bytes / 512);
    shell.args(["-c", &script]).arg(drive.get_program()).args(drive.get_args());
    shell.current_dir(crate::harness::workspace()).stdin(Stdio::null());
    shell.stdout(Stdio::null()).stderr(Stdio::piped());
    ended(shell)
}

/// Waits for the end of a process that must not hang.
fn ended(mut command: Command) -> Output {
    let mut child = command.spawn().expect("it starts");
    wait_for("the end of a drive that cannot write", 60, || child.try_wait().expect("a child"));
    child.wait_with_output().expect("it ended")
}

fn goes_on(arguments: &[&str], folder: tempfile::TempDir) {
    let output = command(&[arguments, &["--resume"]].concat(), folder.path()).output().expect("the binary runs");
    let resumed = finished(folder, output);
    assert!(resumed.output.status.success(), "{}", stderr(&resumed.output));
    assert_eq!(resumed.digests(0), WHOLE.digests(0));
}

#[test]
fn a_drive_that_cannot_write_ends_by_name_and_goes_on() {
    // Half the recording, but more than the ledger takes when it is made.
    let bytes = std::fs::metadata(WHOLE.recording(0)).expect("a recording").len() / 2;
    assert!(bytes > 2 << 20, "the recording is too short for this test: {bytes}");
    for more in [&[][..], &["--processes"][..]] {
        let arguments = [&[SCENARIO, "--vehicle-log"], more].concat();
        let folder = tempfile::tempdir().expect("a temporary folder");
        let output = limited(&arguments, folder.path(), bytes);
        assert_eq!(output.status.code(), Some(STORAGE), "{arguments:?}: {}", stderr(&output));
        assert!(stderr(&output).contains("storage failed"), "{arguments:?}: {}", stderr(&output));
        goes_on(&arguments, folder);
    }
}

#[test]
fn a_full_disk_ends_a_drive_by_name_and_it_goes_on_once_there_is_room() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mount = |size: &str| {
        let option = format!("size={size}");
        let arguments = ["-t", "tmpfs", "-o", &option, "tmpfs", utf8(folder.path())];
        Command::new("mount").args(arguments).stderr(Stdio::null()).status().is_ok_and(|status| status.success())
    };
    if !mount("3m") {
        eprintln!("skipped: no file system may be mounted here");
        return;
    }
    let _unmount = Unmount(folder.path().to_path_buf());
    let out = folder.path().join("out");
    let arguments = [SCENARIO, "--vehicle-log"];
    let mut full = command(&arguments, &out);
    full.stdout(Stdio::null()).stderr(Stdio::piped());
    let output = ended(full);
    assert_eq!(output.status.code(), Some(STORAGE), "{}", stderr(&output));
    assert!(stderr(&output).contains("storage failed"), "{}", stderr(&output));
    let grown = ["-o", "remount,size=64m", utf8(folder.path())];
    assert!(Command::new("mount").args(grown).status().is_ok_and(|status| status.success()));
    let output = command(&[&arguments[..], &["--resume"]].concat(), &out).output().expect("the binary runs");
    assert!(output.status.success(), "{}", stderr(&output));
    let results = std::fs::read_to_string(out.join("results.json")).expect("results");
    let results: Value = serde_json::from_str(&results).expect("JSON");
    for (key, digest) in DIGESTS.iter().zip(WHOLE.digests(0)) {
        assert_eq!(results["episodes"][0][key], digest.as_str(), "{key}");
    }
}

/// Takes the file system away again.
struct Unmount(PathBuf);

impl Drop for Unmount {
    fn drop(&mut self) {
        drop(Command::new("umount").arg(&self.0).status());
    }
}

#[test]
fn a_folder_holds_one_run_at_a_time_and_keeps_the_earlier_ones() {
    const SHORT: [&str; 4] = [SCENARIO, "--vehicle-log", "--duration", "4"];
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut first = start(&SHORT, folder.path());
    wait_for("the first run's ledger", 30, || folder.path().join("ledger.redb").exists().then_some(()));
    let second = command(&SHORT, folder.path()).output().expect("the binary runs");
    assert_eq!(second.status.code(), Some(1), "{}", stderr(&second));
    assert!(stderr(&second).contains("in use by another run"), "{}", stderr(&second));
    let status = wait_for("the first run's end", 120, || first.try_wait().expect("a child"));
    assert!(status.success(), "the second run disturbed the first");

    let output = command(&SHORT, folder.path()).output().expect("the binary runs");
    assert!(stdout(&output).contains("earlier results: "), "{}", stdout(&output));
    let again = finished(folder, output);
    assert!(again.recording(0).exists());
    let earlier = again.folder.path().join("earlier/1");
    let results = std::fs::read_to_string(earlier.join("results.json")).expect("the earlier results");
    let results: Value = serde_json::from_str(&results).expect("JSON");
    assert!(earlier.join(crate::harness::text(&results["episodes"][0]["recording"])).exists(), "{results}");
    // Whoever was refused changed nothing: the run beside which it was started is the one that was alone.
    for (key, digest) in DIGESTS.iter().zip(again.digests(0)) {
        assert_eq!(results["episodes"][0][key], digest.as_str(), "{key}");
    }

    let overwriting = [SCENARIO, "--vehicle-log", "--duration", "1", "--overwrite"];
    let output = command(&overwriting, again.folder.path()).output().expect("the binary runs");
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(!again.folder.path().join("earlier/2").exists());
}

#[test]
fn a_policy_that_is_not_there_is_named_before_anything_starts() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("out");
    let says = refused(&["run", SCENARIO, "--policy", "nobody", "--out", utf8(&out)], 64);
    for part in ["\"nobody\"", "camera", "lattice", "route-follower", "--policy-listen"] {
        assert!(says.contains(part), "no {part:?}: {says}");
    }
    let absent = folder.path().join("absent.safetensors");
    for (policy, file) in [("camera", "absent.safetensors"), ("drivor", "panel/drivor.safetensors")] {
        let weights = ["--policy", policy, "--policy-weights", utf8(&absent)];
        let says = refused(&[["run", SCENARIO].as_slice(), &weights, &["--out", utf8(&out)]].concat(), 64);
        assert!(says.contains(file), "no {file:?}: {says}");
        assert!(says.contains(&format!("train policy --kind {policy}")), "nobody says how it is trained: {says}");
    }
    let says = refused(&["run", SCENARIO, "--appearance", "plaid", "--out", utf8(&out)], 64);
    assert!(says.contains("plaid"), "{says}");
    assert!(!out.exists(), "nothing is begun");
}

#[test]
fn tables_say_what_they_show() {
    let shown = stdout(&WHOLE.output);
    let scored = stdout(&run(&["score", utf8(&WHOLE.recording(0))]));
    for title in ["driving score", "route completion", "mean score"] {
        assert!(shown.contains(title) && scored.contains(title), "no {title:?}: {shown}{scored}");
    }
    let doctor = stdout(&run(&["doctor"]));
    assert!(doctor.contains("software rasteriser") && !doctor.contains("chosen"), "{doctor}");
    assert!(doctor.contains("panel") && doctor.contains("drivor"), "{doctor}");
}

/// Lets nobody read what a command says, and returns its exit code.
fn unread(mut command: Command) -> Option<i32> {
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let status = command.stdout(writer.try_clone().expect("a second end")).stderr(writer).status();
    status.expect("the binary runs").code()
}

#[test]
fn a_reader_who_leaves_changes_no_exit_code() {
    for (arguments, code) in [
        (&["--help"][..], 0),
        (&["completion", "bash"], 0),
        (&["gap", "effects"], 0),
        (&["scenario", "show", SCENARIO], 0),
        (&["scenario", "show", "none.scenario.json"], 1),
        (&["run", SCENARIO, "--policy", "none"], 64),
        (&["benchmark", "check", "none.set.json"], 2),
    ] {
        assert_eq!(unread(dreamstream(arguments)), Some(code), "{arguments:?}");
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    assert_eq!(unread(command(&["--log", "debug", SCENARIO, "--duration", "1"], folder.path())), Some(0));
    assert!(folder.path().join("results.json").exists(), "the work goes on");
    let Ok(full) = std::fs::File::create("/dev/full") else { return eprintln!("skipped: no /dev/full") };
    let lost = dreamstream(&["gap", "effects"]).stdout(full).output().expect("the binary runs");
    assert_eq!(lost.status.code(), Some(STORAGE), "{}", stderr(&lost));
    assert!(stderr(&lost).contains("stdout"), "{}", stderr(&lost));
}

//! Policies in Python drive over the policy bus from another process: alone, several sessions at once, as an agent of
//! NAVSIM's interface, and as a ROS 2 node; bad ones end their drive by name.

use std::io::Read;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use crate::harness::{Drive, command, finished, free_port, python, python_with, text, workspace};

const SCENARIO: &str = "scenarios/base/free-curve.scenario.json";
const OTHER: &str = "scenarios/base/cut-in.scenario.json";

struct Guest(Child);

impl Drop for Guest {
    fn drop(&mut self) {
        let _already_gone = self.0.kill();
        let _reaped = self.0.wait();
    }
}

/// Starts a Python module that connects to a drive as policy `mine`.
fn guest(python: &Path, module: &[&str], endpoint: &str) -> Guest {
    let mut guest = Command::new(python);
    guest.arg("-m").args(module).args(["--name", "mine", "--connect", endpoint]).current_dir(workspace());
    guest.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::inherit());
    Guest(guest.spawn().expect("python starts"))
}

fn endpoint() -> String {
    format!("tcp/127.0.0.1:{}", free_port())
}

/// Drives with whoever connects as `mine`.
fn drive_by(endpoint: &str, further: &[&str]) -> Drive {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shared = ["--policy", "mine", "--policy-listen", endpoint, "--observation", "layout", "--duration", "2"];
    let output = command(&[further, &shared].concat(), folder.path()).output().expect("runs");
    finished(folder, output)
}

/// Drives with a Python class; returns the episode.
fn drive_with(source: &str, class: &str) -> Option<serde_json::Value> {
    let python = python()?;
    let folder = tempfile::tempdir().expect("a temporary folder");
    let script = folder.path().join("mine.py");
    std::fs::write(&script, source).expect("a script");
    let endpoint = endpoint();
    let _guest = guest(&python, &["dreamstream", "run", &format!("{}:{class}", script.display())], &endpoint);
    Some(drive_by(&endpoint, &[SCENARIO]).episode(0).clone())
}

#[test]
fn ten_lines_drive_an_episode() {
    let source =
        std::fs::read_to_string(workspace().join("clients/python/examples/constant_velocity.py")).expect("the example");
    let Some(episode) = drive_with(&source, "ConstantVelocity") else { return };
    assert_eq!(episode["status"], "completed", "{episode}");
    assert_eq!(episode["ticks"], 20);
}

#[test]
fn the_clients_own_tests_pass() {
    let Some(python) = python().and_then(|_| python_with("client", &["./clients/python[test]"])) else { return };
    // From here, so that the installed client is tested.
    let tests =
        Command::new(python.with_file_name("pytest")).args(["-q", "clients/python"]).current_dir(workspace()).output();
    let tests = tests.expect("pytest runs");
    assert!(tests.status.success(), "{}", String::from_utf8_lossy(&tests.stdout));
}

#[test]
fn bad_answers_end_the_drive_with_a_named_reason() {
    let cases = [
        ("np.full((4, 3), np.nan)", "nan"),
        ("np.zeros((0, 3))", "pose"),
        ("np.zeros((4, 7))", ""),
        ("np.full((4, 3), 1e9)", ""),
    ];
    for (answer, says) in cases {
        let source = format!(
            "import numpy as np\nfrom dreamstream import Policy\n\nclass Bad(Policy):\n    def plan(self, observation):\n        return {answer}\n"
        );
        let Some(episode) = drive_with(&source, "Bad") else { return };
        assert_eq!(episode["status"], "failed", "{answer}: {episode}");
        let reason = text(&episode["reason"]).to_lowercase();
        assert!(reason.starts_with("policy") || reason.starts_with("plan"), "{answer}: {reason:?}");
        assert!(reason.contains(says), "{answer}: {reason:?} does not say {says:?}");
    }
}

#[test]
fn a_context_that_changes_its_size_within_a_drive_is_refused_by_name() {
    let source = "import numpy as np
from dreamstream import Plan, Policy

class Growing(Policy):
    def plan(self, observation):
        times_s = 0.5 * np.arange(1, 17)
        way_m = observation.ego.speed_mps * times_s
        context = np.zeros((1 + observation.sequence // 2, 4))
        return Plan(np.stack([way_m, 0 * way_m, 0 * way_m], axis=1), times_s, context=context)
";
    let Some(episode) = drive_with(source, "Growing") else { return };
    assert_eq!(episode["status"], "failed", "{episode}");
    let reason = text(&episode["reason"]);
    assert!(reason.contains("plan.context is [2, 4], in the first answer [1, 4]"), "{reason}");
}

/// Plans from the frames by a matrix product, notes how many different observations came together.
const TOGETHER: &str = "import time
from pathlib import Path
import numpy as np
from dreamstream import Policy

class Together(Policy):
    batch = 4
    gather_s = 5.0
    weights = np.random.default_rng(0).standard_normal((480, 24)).astype(np.float32)

    def plan_batch(self, observations):
        assert len(observations) == self.batch
        if not Path(__file__).with_name('met').exists():
            time.sleep(3)  # until the other drive has begun
        with Path(__file__).with_name('met').open('a') as met:
            print(len({id(seen) for seen in observations}), file=met)
        seen = np.stack([seen.frames['front'][-1][40, :160].reshape(-1) for seen in observations]).astype(np.float32)
        offsets = (seen @ self.weights).reshape(self.batch, 8, 3) * np.float32(1e-6)
        way_m = np.array([seen.ego.speed_mps for seen in observations])[:, None] * 0.5 * np.arange(1, 9)
        return list(offsets + np.stack([way_m, 0 * way_m, 0 * way_m], axis=-1))
";

#[test]
fn two_drives_at_once_through_one_process_are_as_each_alone() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let script = folder.path().join("mine.py");
    std::fs::write(&script, TOGETHER).expect("a script");
    let class = format!("{}:Together", script.display());
    let drive = |scenarios: &[&str]| {
        let endpoint = endpoint();
        let _guest = guest(&python, &["dreamstream", "run", &class], &endpoint);
        let drive = drive_by(&endpoint, &[scenarios, &["--workers", "2"]].concat());
        let met = std::fs::read_to_string(folder.path().join("met")).expect("the policy was asked");
        std::fs::remove_file(folder.path().join("met")).expect("removed");
        let most = met.lines().map(|line| line.parse::<usize>().expect("a number")).max();
        (drive, most.expect("a call"))
    };
    let (both, most) = drive(&[SCENARIO, OTHER]);
    assert_eq!(most, 2, "both sessions met in one call");
    for (index, scenario) in [SCENARIO, OTHER].into_iter().enumerate() {
        let (alone, most) = drive(&[scenario]);
        assert_eq!(most, 1);
        assert_eq!(alone.episode(0)["status"], "completed", "{}", alone.episode(0));
        let same =
            (0..2).find(|other| both.episode(*other)["scenario"] == alone.episode(0)["scenario"]).unwrap_or(index);
        assert_eq!(both.digests(same), alone.digests(0), "{scenario}");
    }
}

/// Takes one session at a time, notes its beginning, and is slow.
const ALONE: &str = "import time
from pathlib import Path
from dreamstream import Policy

class Alone(Policy):
    at_once = 1

    def begin(self, *, session):
        Path(__file__).with_name('began').touch()

    def plan(self, observation):
        time.sleep(0.3)
        return [[observation.ego.speed_mps * k, 0, 0] for k in range(1, 9)]
";

#[test]
fn a_drive_that_was_killed_leaves_room_for_the_next_one() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let script = folder.path().join("mine.py");
    std::fs::write(&script, ALONE).expect("a script");
    let endpoint = endpoint();
    let _guest = guest(&python, &["dreamstream", "run", &format!("{}:Alone", script.display())], &endpoint);
    let shared = [SCENARIO, "--policy", "mine", "--policy-listen", &endpoint, "--observation", "layout"];
    let mut killed = crate::harness::start(&shared, folder.path());
    crate::harness::wait_for("the session to begin", 60, || folder.path().join("began").exists().then_some(()));
    killed.kill().expect("the drive runs");
    killed.wait().expect("the drive ends");
    let drive = drive_by(&endpoint, &[SCENARIO]);
    assert_eq!(drive.episode(0)["status"], "completed", "{}", drive.episode(0));
}

#[test]
fn an_agent_of_navsims_interface_drives() {
    let Some(python) = python() else { return };
    let class = format!("{}:Mine", workspace().join("clients/python/examples/navsim_agent.py").display());
    let endpoint = endpoint();
    let _guest = guest(&python, &["dreamstream", "run", &class], &endpoint);
    let drive = drive_by(&endpoint, &[SCENARIO, "--history", "16", "--scorer", "oracle"]);
    assert_eq!(drive.episode(0)["status"], "completed", "{}", drive.episode(0));
}

/// Reads how far the plans of two recordings lie apart, and those of different moments of one.
fn compared(python: &Path, one: &Drive, other: &Drive) -> String {
    let script = workspace().join("tests/own_policy.py");
    let mut compare = Command::new(python);
    let read = compare.arg(script).arg("compare").arg(one.recording(0)).arg(other.recording(0)).output();
    let read = read.expect("python runs");
    assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
    String::from_utf8_lossy(&read.stdout).into_owned()
}

#[test]
fn a_ros_2_node_behind_the_bridge_drives_as_the_same_driver_connected_directly() {
    let Some(python) = python().and_then(|_| python_with("client", &["./clients/python[test]"])) else { return };
    let script = workspace().join("tests/ros2_node.py");
    let (here, ros) = (endpoint(), endpoint());
    let mut node = Command::new(&python);
    node.arg(&script).arg(&ros).stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut node = Guest(node.spawn().expect("python starts"));
    let by_ros = {
        let _guest = guest(&python, &["dreamstream.ros2", "--ros", &ros], &here);
        drive_by(&here, &[SCENARIO, "--history", "3"])
    };
    drop(node.0.stdin.take());
    let mut said = String::new();
    node.0.stdout.take().expect("a pipe").read_to_string(&mut said).expect("the node's last words");
    let heard: serde_json::Value = serde_json::from_str(&said).expect("JSON");

    let directly = endpoint();
    let _guest = guest(&python, &["dreamstream", "run", &format!("{}:Direct", script.display())], &directly);
    let direct = drive_by(&directly, &[SCENARIO, "--history", "3"]);
    assert_eq!(direct.episode(0)["status"], "completed", "{}", direct.episode(0));
    assert_eq!(by_ros.digests(0), direct.digests(0), "{heard}");
    let said = compared(&python, &by_ros, &direct);
    assert!(said.starts_with("0.0 ") && !said.ends_with(" 0.0\n"), "{said}");

    // A plan each half second, the three frames before it that were not told yet.
    let counts = &heard["counts"];
    for topic in ["clock", "dreamstream/odom", "dreamstream/accel", "dreamstream/camera/front/image_raw"] {
        assert!(counts[topic].as_u64() >= Some(8), "{topic}: {heard}");
    }
    assert!(counts["tf_static"].as_u64() >= Some(1) && heard["clock_rises"] == true, "{heard}");
    let token = "MP/dreamstream§camera§front§image_raw/sensor_msgs§msg§Image/:1:0:0,10";
    let tokens = heard["tokens"].as_array().expect("tokens");
    assert!(tokens.iter().any(|one| one == token) && tokens.len() == 8, "{heard}");
}

/// Drives as the expert does, known by its frame, and wraps that wrongly.
const EXAMINED: &str = "import hashlib, json
from pathlib import Path
import numpy as np
from dreamstream import Policy

HERE = Path(__file__).parent
key = lambda seen: hashlib.sha256(seen.frames['front'][-1].tobytes()).hexdigest()

class Note(Policy):
    def plan(self, observation):
        with (HERE / 'seen').open('a') as seen:
            print(key(observation), file=seen)
        return [[0.1, 0.0, 0.0]]

class Sound(Policy):
    spacing_s, known, calls = 0.1, {}, 0

    def plan(self, observation):
        Sound.calls += 1
        if not self.known:
            asked = (HERE / 'seen').read_text().split()[1:9]
            self.known.update(zip(asked, json.loads((HERE / 'told').read_text())['experts']))
        return self.wrap(*np.array(self.known[key(observation)]).T)

    def wrap(self, x, y, turned):
        return np.stack([x, y, turned], axis=1)

class Swapped(Sound):
    wrap = lambda self, x, y, turned: np.stack([y, x, turned], axis=1)

class Degrees(Sound):
    wrap = lambda self, x, y, turned: np.stack([x, y, np.degrees(turned)], axis=1)

class Rate(Sound):
    wrap = lambda self, x, y, turned: np.stack([x, y, turned], axis=1)[4::5]

class Centre(Sound):
    wrap = lambda self, x, y, turned: np.stack([x + 1.4 * (np.cos(turned) - 1), y + 1.4 * np.sin(turned), turned], axis=1)

class Absolute(Sound):
    wrap = lambda self, x, y, turned: np.stack([x + 31, y - 8, turned], axis=1)

class Shared(Sound):
    wrap = lambda self, x, y, turned: np.stack([x, y + 0.01 * Sound.calls, turned], axis=1)

class Once(Sound):
    wrap = lambda self, x, y, turned: np.stack([x, np.where(Sound.calls == 99, np.nan, y), turned], axis=1)

class Mixed(Sound):
    batch, gather_s = 8, 2.0

    def plan_batch(self, observations):
        plans = [self.plan(seen) for seen in observations]
        return [plan + [0, 0.1 * (len({id(seen) for seen in observations}) - 1), 0] for plan in plans]
";

#[test]
fn the_doctor_names_what_is_wrong_with_a_python_policy() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let script = folder.path().join("mine.py");
    std::fs::write(&script, EXAMINED).expect("a script");
    let doctor = |class: &str| {
        let policy = format!("{}:{class}", script.display());
        let mut doctor = crate::harness::dreamstream(&["policy", "doctor", &policy, "--json", "--python"]);
        let output = doctor.arg(&python).output().expect("runs");
        let said = String::from_utf8_lossy(&output.stdout).into_owned();
        let told = serde_json::from_str::<serde_json::Value>(&said);
        (told.unwrap_or_else(|error| panic!("{class}: {error}: {}", String::from_utf8_lossy(&output.stderr))), output)
    };
    let (told, _) = doctor("Note");
    std::fs::write(folder.path().join("told"), told.to_string()).expect("write");
    let (told, output) = doctor("Sound");
    assert!(output.status.success() && told["findings"] == serde_json::json!([]), "{told}");
    let remark = &told["remarks"][0];
    assert_eq!(remark["says"], "answers to 2 and 8 at once are those alone", "{told}");
    let rows = [
        ("Swapped", "axes", "x and y swapped"),
        ("Degrees", "units", "degrees"),
        ("Rate", "rate", "0.5 s apart but declared 0.1 s"),
        ("Centre", "origin", "centre"),
        ("Absolute", "origin", "absolute"),
        ("Shared", "state", "keeps state"),
        ("Once", "finite", "is nan"),
        ("Mixed", "batch", "rows of a batch are mixed"),
    ];
    for (class, check, says) in rows {
        let (told, output) = doctor(class);
        assert_eq!(output.status.code(), Some(1), "{class}: {told}");
        let first = &told["findings"][0];
        assert!(first["check"] == check && text(&first["says"]).contains(says), "{class}: {told}");
    }
    let mut doctor = crate::harness::dreamstream(&["policy", "doctor", "none.py:Mine", "--python"]);
    let said = doctor.arg(&python).output().expect("runs").stderr;
    let said = String::from_utf8_lossy(&said).into_owned();
    assert!(said.contains("there is no file") && said.contains("ended before it answered"), "{said}");
}

#[test]
fn an_independent_reader_opens_the_recording() {
    let Some(python) = python() else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = command(
        &[SCENARIO, "--observation", "layout", "--policy", "constant-velocity", "--duration", "2"],
        folder.path(),
    )
    .output()
    .expect("runs");
    let drive = finished(folder, output);
    let script = workspace().join("tests/read_recording.py");
    let read = Command::new(python).arg(script).arg(drive.recording(0)).output().expect("python runs");
    let said = String::from_utf8_lossy(&read.stdout).into_owned();
    assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
    let counts: serde_json::Value = serde_json::from_str(&said).expect("counts as JSON");
    assert_eq!(counts["world"], 21, "{counts}");
    assert_eq!(counts["frame"], 21, "{counts}");
    assert_eq!(counts["layout"], 21, "{counts}");
    assert_eq!(counts["plan"], 4, "{counts}");
}

//! What the system tests share: the workspace, real data, and drives by the real binary in temporary folders.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

use serde_json::Value;

/// Returns the root of the workspace.
pub(crate) fn workspace() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// Returns a folder of the real data beside the checkout, or says that the test is skipped.
pub(crate) fn shared(folder: &str) -> Option<PathBuf> {
    let path = workspace().join("../shared").join(folder);
    if path.exists() {
        return Some(path);
    }
    eprintln!("skipped: ../shared/{folder} is absent");
    None
}

/// Returns the binary with the workspace as its folder.
pub(crate) fn dreamstream(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_dreamstream"));
    command.args(arguments).current_dir(workspace()).stdin(Stdio::null());
    command
}

/// A finished drive.
pub(crate) struct Drive {
    pub folder: tempfile::TempDir,
    pub results: Value,
    pub output: Output,
}

impl Drive {
    /// Returns the entry of an episode.
    pub(crate) fn episode(&self, index: usize) -> &Value {
        &self.results["episodes"][index]
    }

    /// Returns the three digests of an episode.
    pub(crate) fn digests(&self, index: usize) -> [String; 3] {
        ["world_digest", "layout_digest", "frame_digest"].map(|key| text(&self.episode(index)[key]))
    }

    /// Returns the path of an episode's recording.
    pub(crate) fn recording(&self, index: usize) -> PathBuf {
        self.folder.path().join(text(&self.episode(index)["recording"]))
    }
}

/// Returns a JSON text.
pub(crate) fn text(value: &Value) -> String {
    value.as_str().unwrap_or_default().to_owned()
}

/// Runs `dreamstream run` with `arguments` in a folder of its own and reads its results.
pub(crate) fn drive(arguments: &[&str]) -> Drive {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let output = command(arguments, folder.path()).output().expect("the binary runs");
    finished(folder, output)
}

/// Returns the command of a drive that writes to `out`.
pub(crate) fn command(arguments: &[&str], out: &Path) -> Command {
    let mut command = dreamstream(&["run"]);
    command.args(arguments).arg("--no-pictures").arg("--out").arg(out);
    command
}

/// Reads the results of a drive that ended.
pub(crate) fn finished(folder: tempfile::TempDir, output: Output) -> Drive {
    let path = folder.path().join("results.json");
    let results = match std::fs::read_to_string(&path) {
        Ok(text) => serde_json::from_str(&text).expect("results are JSON"),
        Err(error) => panic!("no results ({error}): {}", String::from_utf8_lossy(&output.stderr)),
    };
    Drive { folder, results, output }
}

/// Starts a drive and returns the process; its output goes to a file in `out`.
pub(crate) fn start(arguments: &[&str], out: &Path) -> Child {
    let log = std::fs::File::create(out.join("stderr.txt")).expect("a log file");
    let mut command = command(arguments, out);
    command.stdout(Stdio::null()).stderr(log).spawn().expect("the binary starts")
}

/// Waits until `condition` holds, for at most `secs` seconds.
pub(crate) fn wait_for<T>(what: &str, secs: u64, mut condition: impl FnMut() -> Option<T>) -> T {
    for _ in 0..secs * 50 {
        if let Some(value) = condition() {
            return value;
        }
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    panic!("waited {secs} s for {what}");
}

/// Returns the process ids of child processes of `parent` whose command line holds `word`.
pub(crate) fn children(parent: u32, word: &str) -> Vec<u32> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir("/proc").expect("/proc").flatten() {
        let Some(pid) = entry.file_name().to_str().and_then(|name| name.parse::<u32>().ok()) else { continue };
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        let after = stat.rsplit(')').next().unwrap_or_default();
        let is_child = after.split_whitespace().nth(1).and_then(|ppid| ppid.parse().ok()) == Some(parent);
        let line = std::fs::read_to_string(format!("/proc/{pid}/cmdline")).unwrap_or_default();
        if is_child && line.split('\0').any(|argument| argument == word) {
            found.push(pid);
        }
    }
    found.sort_unstable();
    found
}

/// Sends a signal such as `KILL` to a process, by the shell's own `kill`: a bare Debian has no program of that name.
pub(crate) fn signal(pid: u32, name: &str) {
    let status = Command::new("sh").args(["-c", &format!("kill -{name} {pid}")]).status();
    assert!(status.is_ok_and(|status| status.success()), "kill -{name} {pid} failed");
}

/// Returns the Python of an environment that holds the client and an independent MCAP reader, made at the first call;
/// says so and returns `None` where Python cannot make one.
pub(crate) fn python() -> Option<PathBuf> {
    python_with("ready", &["./clients/python", "mcap", "mcap-protobuf-support", "pytest"])
}

/// Returns the Python of [`python`] with further `packages`, installed once under the name `stamp`.
///
/// Tests of one binary run at the same time: whoever makes or fills the environment holds its lock.
pub(crate) fn python_with(stamp: &str, packages: &[&str]) -> Option<PathBuf> {
    let folder = workspace().join("target/test-python");
    let python = folder.join("bin/python");
    let lock = std::fs::File::create(folder.with_extension("lock")).expect("a lock beside the environment");
    lock.lock().expect("the environment's lock");
    if !folder.join("ready").exists() {
        let made = Command::new("python3").args(["-m", "venv", "--clear"]).arg(&folder).output();
        if !made.is_ok_and(|output| output.status.success()) {
            return without_python("python3 -m venv does not work");
        }
    }
    if !folder.join(stamp).exists() {
        let mut install = Command::new(&python);
        let output = install.args(["-m", "pip", "install", "-q"]).args(packages).current_dir(workspace()).output();
        match output {
            Ok(output) if output.status.success() => std::fs::write(folder.join(stamp), "").expect("a stamp"),
            Ok(output) => return without_python(&String::from_utf8_lossy(&output.stderr)),
            Err(error) => return without_python(&error.to_string()),
        }
    }
    Some(python)
}

fn without_python(why: &str) -> Option<PathBuf> {
    assert!(std::env::var_os("DREAMSTREAM_REQUIRE_PYTHON").is_none(), "Python is required here: {why}");
    eprintln!("skipped: {why}");
    None
}

/// Returns a free port on loopback.
pub(crate) fn free_port() -> u16 {
    ds_bus::free_port("127.0.0.1").expect("a free port")
}

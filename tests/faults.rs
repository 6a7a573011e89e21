//! Killed and stopped processes on the real bus: the drive ends with the digests of an undisturbed one.

use std::path::Path;
use std::process::Child;
use std::sync::LazyLock;

use crate::harness::{Drive, children, drive, finished, signal, start, wait_for};

const SCENARIO: &str = "scenarios/base/free-curve.scenario.json";
const DRIVE: [&str; 6] = [SCENARIO, "--processes", "--workers", "2", "--duration", "5"];

/// The drive that nothing disturbs.
static UNDISTURBED: LazyLock<Drive> = LazyLock::new(|| drive(&DRIVE));

fn recorded_bytes(out: &Path) -> u64 {
    let folder = out.join("recordings");
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter_map(|entry| entry.metadata().ok()).map(|data| data.len()).sum()
}

/// Waits until so many bytes are in the journal.
fn wait_for_bytes(out: &Path, bytes: u64) {
    wait_for("the journal to grow", 120, || (recorded_bytes(out) >= bytes).then_some(()));
}

fn end(mut child: Child, folder: tempfile::TempDir) -> Drive {
    let status = child.wait().expect("the drive ends");
    let log = std::fs::read_to_string(folder.path().join("stderr.txt")).unwrap_or_default();
    assert!(status.success(), "{status}: {log}");
    let output = std::process::Output { status, stdout: Vec::new(), stderr: log.into_bytes() };
    finished(folder, output)
}

/// Kills one instance of a service when the journal has a share of its size; another takes over.
fn with_a_killed(service: &str, size: u64, share: f64) -> [String; 3] {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let child = start(&DRIVE, folder.path());
    wait_for_bytes(folder.path(), (size as f64 * share) as u64);
    // Late in a drive the service may be gone already: then the drive was undisturbed, and says so by its digests.
    match children(child.id(), service).first() {
        Some(found) => signal(*found, "KILL"),
        None => assert!(share > 0.8, "no {service} runs at {share} of the journal"),
    }
    end(child, folder).digests(0)
}

#[test]
fn a_killed_service_changes_nothing() {
    assert_eq!(UNDISTURBED.episode(0)["status"], "completed");
    let size = std::fs::metadata(UNDISTURBED.recording(0)).expect("a recording").len();
    let digests = UNDISTURBED.digests(0);
    // The video model's window is full after 24 frames, half of the journal: before the first eviction, after it, and in
    // one of the last iterations. Nearly all time is spent within chunks, so each falls into one.
    let early = [("vdm-worker", 0.1), ("vdm-worker", 0.6), ("sim-server", 0.3)];
    let late = [("vdm-worker", 0.88), ("orchestrator", 0.4)];
    let each = |moments: &[(&str, f64)]| {
        for (service, share) in moments {
            assert_eq!(with_a_killed(service, size, *share), digests, "{service} killed at {share} of the journal");
        }
    };
    // Two drives at a time: while one waits for a lease to end, the other works.
    std::thread::scope(|scope| {
        scope.spawn(|| each(&early));
        each(&late);
    });
}

#[test]
fn a_stopped_receiver_loses_nothing() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let child = start(&DRIVE, folder.path());
    wait_for_bytes(folder.path(), 200_000);
    let stopped = children(child.id(), "layout-render")[0];
    signal(stopped, "STOP");
    std::thread::sleep(std::time::Duration::from_secs(10));
    signal(stopped, "CONT");
    assert_eq!(end(child, folder).digests(0), UNDISTURBED.digests(0));
}

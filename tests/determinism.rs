//! Same scenario, seed and weights give the same digests, whatever the number of workers, the wiring or the losses.

use crate::harness::drive;

const SCENARIOS: [&str; 2] = ["scenarios/base/cut-in.scenario.json", "scenarios/base/free-curve.scenario.json"];
const SHORT: [&str; 2] = ["--duration", "3"];

fn all(extra: &[&str]) -> Vec<[String; 3]> {
    let arguments = [&SCENARIOS[..], &SHORT[..], extra].concat();
    let drive = drive(&arguments);
    let episodes = drive.results["episodes"].as_array().expect("a list").len();
    (0..episodes).map(|index| drive.digests(index)).collect()
}

/// Drives with each of several settings at the same time: who loses pushes waits more than it works.
fn at_once(settings: &[Vec<&str>]) -> Vec<Vec<[String; 3]>> {
    std::thread::scope(|scope| {
        let runs: Vec<_> = settings.iter().map(|extra| scope.spawn(|| all(extra))).collect();
        runs.into_iter().map(|run| run.join().expect("a run")).collect()
    })
}

#[test]
fn digests_do_not_depend_on_workers_wiring_or_lost_pushes() {
    let losses = ["0.3", "1"];
    let lossy = std::thread::spawn(move || at_once(&losses.map(|share| vec!["--drop-pushes", share])));
    let first = all(&[]);
    assert_eq!(first, all(&[]), "two runs");
    assert_eq!(first, all(&["--workers", "1"]), "one worker, not as many as cores serve");
    assert_eq!(first, all(&["--workers", "3"]), "three workers");
    assert_eq!(first, all(&["--processes", "--workers", "2"]), "processes");
    for (share, digests) in losses.into_iter().zip(lossy.join().expect("runs")) {
        assert_eq!(first, digests, "a share of {share} of all pushes lost");
    }
}

#[test]
fn policies_that_see_the_live_world_drive_alike_as_processes() {
    let settings =
        |policy| vec!["--policy", policy, "--observation", "layout", "--agents", "idm-all", "--warm-up", "4"];
    let policies = ["idm", "careful", "expert"];
    let apart = policies.map(|policy| [settings(policy), vec!["--processes", "--drop-pushes", "0.3"]].concat());
    for (policy, digests) in policies.into_iter().zip(at_once(&apart)) {
        assert_eq!(all(&settings(policy)), digests, "{policy}");
    }
}

#[test]
fn the_seed_changes_frames_and_nothing_before_them() {
    let base = ["scenarios/base/free-curve.scenario.json", "--duration", "1", "--policy", "log-replay"];
    let [one, two] = ["1", "2"].map(|seed| drive(&[&base[..], &["--seed", seed]].concat()).digests(0));
    assert_eq!(one[..2], two[..2], "world and layout do not depend on the seed of the frames");
    assert_ne!(one[2], two[2], "frames are drawn with the seed");
}

#[test]
fn threads_are_part_of_the_compute_class() {
    let run = |threads: &str| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let mut command = crate::harness::command(&[SCENARIOS[1], "--duration", "2"], folder.path());
        let output = command.env("RAYON_NUM_THREADS", threads).output().expect("runs");
        let drive = crate::harness::finished(folder, output);
        (drive.digests(0), drive.results["run"]["compute_classes"]["video"].clone())
    };
    let (one, two) = (run("1"), run("2"));
    assert!(one.0 == two.0 || one.1 != two.1, "{one:?} {two:?}");
}

//! Wall-clock mode: an answer that is late by real time is counted and not waited for; nothing of it is found in any other
//! drive, and results of both kinds are not mixed.

use std::collections::BTreeSet;
use std::path::Path;
use std::time::Duration;

use crate::harness::{Drive, dreamstream, finished, free_port, start, wait_for};
use ds_bus::{FromBridge, FromPolicy, PolicyGuest};
use ds_record::Recording;
use ds_space::{InstanceId, PoseSe2, SimTime};
use ds_topic::{Plan, Topic};
use ds_wire::policy::{PolicyHello, PolicyPlan};
use ds_wire::verify;
use ds_world::{Trajectory, TrajectoryPoint};

const SCENARIO: &str = "scenarios/base/free-curve.scenario.json";
/// Longer than the replan period of 0.5 s.
const SLOW: Duration = Duration::from_millis(800);

/// Returns a plan that drives straight on at 5 m/s for 4 s.
fn straight() -> Plan {
    let point = |step: i32| {
        let secs = 0.5 * f64::from(step);
        TrajectoryPoint { after: SimTime::from_secs(secs), pose: PoseSe2::new(5.0 * secs, 0.0, 0.0) }
    };
    let trajectory = Trajectory::new((1..=8).map(point).collect()).expect("sound");
    Plan { trajectory, proposals: Vec::new(), observed: None, answered: None, context: None }
}

/// Answers at once, but for the third observation of a session, which it thinks about for [`SLOW`].
async fn answer(endpoint: &str) {
    let name = InstanceId::new("mine").expect("an id");
    let mut guest = loop {
        match PolicyGuest::connect(&name, endpoint, None).await {
            Ok(guest) => break guest,
            Err(_not_yet) => tokio::task::yield_now().await,
        }
    };
    let mut thought_about = BTreeSet::new();
    while let Ok((session, message)) = guest.recv().await {
        let said = match message {
            FromBridge::Hello(_) => FromPolicy::Ready(PolicyHello { name: "straight on".to_owned() }),
            FromBridge::Observation(observation) => {
                if thought_about.insert(observation.sequence) && observation.sequence == 2 {
                    tokio::time::sleep(SLOW).await;
                }
                FromPolicy::Plan(PolicyPlan { for_sequence: observation.sequence, plan: straight() })
            }
            FromBridge::Goodbye(_) => return,
        };
        guest.put(&session, &said).await.expect("the bridge listens");
    }
}

/// Drives the policy above for 4 s.
fn driven(more: &[&str]) -> Drive {
    let runtime = tokio::runtime::Runtime::new().expect("a runtime");
    let endpoint = format!("tcp/127.0.0.1:{}", free_port());
    let folder = tempfile::tempdir().expect("a temporary folder");
    let what = [SCENARIO, "--duration", "4", "--observation", "reference", "--policy", "mine", "--policy-listen"];
    let mut run = start(&[&what[..], &[endpoint.as_str()], more].concat(), folder.path());
    let guest = runtime.spawn(async move { answer(&endpoint).await });
    let status = wait_for("the end of the drive", 120, || run.try_wait().expect("a child"));
    guest.abort();
    let stderr = std::fs::read(folder.path().join("stderr.txt")).unwrap_or_default();
    let drive = finished(folder, std::process::Output { status, stdout: Vec::new(), stderr });
    assert!(drive.output.status.success(), "{}", String::from_utf8_lossy(&drive.output.stderr));
    drive
}

fn plans(drive: &Drive) -> Vec<Plan> {
    let recording = Recording::open(&drive.recording(0)).expect("a recording");
    recording.topic(Topic::Plan).map(|envelope| verify::<Plan>(envelope).expect("a sound message")).collect()
}

/// Runs a command on two folders that it must refuse because of their clocks.
fn refused(command: &[&str], folders: [&Path; 2], code: i32) {
    let folders = folders.map(|folder| folder.display().to_string());
    let output = dreamstream(&[command, &[&folders[0], &folders[1]]].concat()).output().expect("the binary runs");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(code) && said.contains("by the wall clock"), "{command:?}: {said}");
}

#[test]
fn late_answers_are_counted_and_results_not_mixed() {
    let paced = driven(&["--wall-clock"]);
    let kept = &paced.episode(0)["wall_clock"];
    let number = |name: &str| kept[name].as_f64().expect("a number");
    let told = plans(&paced);
    assert_eq!(paced.results["run"]["wall_clock"], true);
    assert_eq!(number("plans"), told.len() as f64);
    assert!(number("late") >= 1.0 && number("late") < number("plans") - 2.0, "{kept}");
    assert!((0.8..5.0).contains(&number("latency_max_s")) && number("latency_median_s") < 0.5, "{kept}");
    let late = told.iter().filter(|plan| plan.answered.as_ref().expect("its answer").iterations_late > 0).count();
    assert_eq!(number("late"), late as f64);
    let real_secs = 0.5 * (number("plans") - 1.0);
    assert!(paced.episode(0)["wall_s"].as_f64() > Some(real_secs), "faster than real time: {}", paced.episode(0));

    // The same policy without the clock is waited for, and nothing tells how long it took.
    let free = driven(&[]);
    assert_eq!((&free.results["run"]["wall_clock"], free.episode(0).get("wall_clock")), (&false.into(), None));
    assert!(plans(&free).iter().all(|plan| plan.answered.is_none()));
    let again = driven(&[]);
    assert_eq!(free.digests(0), again.digests(0));

    let folders = [paced.folder.path(), free.folder.path()];
    let out = tempfile::tempdir().expect("a temporary folder");
    let to = out.path().display().to_string();
    refused(&["compare"], folders, 64);
    refused(&["report", "--out", &to], folders, 64);
    refused(&["merge", "--force", "--out", &to], folders, 1);
    let [a, b] = folders.map(|folder| folder.display().to_string());
    let forced = dreamstream(&["compare", "--force", &a, &b]).output().expect("the binary runs");
    let said = String::from_utf8_lossy(&forced.stdout).into_owned();
    assert!(forced.status.success() && said.contains("only one of the runs was driven by the wall clock"), "{said}");
}

#[test]
fn only_who_connects_is_driven_by_the_wall_clock() {
    let refused =
        dreamstream(&["run", SCENARIO, "--policy", "lattice", "--wall-clock"]).output().expect("the binary runs");
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(refused.status.code() == Some(64) && said.contains("--policy-listen"), "{said}");
}

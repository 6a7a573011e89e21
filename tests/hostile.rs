//! Bad input at every border gets a clear error, and what was there before still works.

use std::path::Path;
use std::process::{Child, Stdio};

use crate::harness::{dreamstream, free_port, workspace};
use ds_raster::{Encoding, RgbImage};
use ds_wire::control as pb;
use pb::runs_client::RunsClient;
use tonic::Code;
use tonic::transport::Channel;

const SCENARIO: &str = "scenarios/base/free-curve.scenario.json";

/// Runs the binary and checks that it fails with `code`, says `says` on stderr, and does not panic.
fn refused(arguments: &[&str], code: i32, says: &str) {
    let output = dreamstream(arguments).output().expect("the binary runs");
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {error}");
    assert!(error.contains(says), "{arguments:?} does not say {says:?}: {error}");
    assert!(!error.contains("panicked"), "{arguments:?}: {error}");
}

fn write(folder: &Path, name: &str, content: &[u8]) -> String {
    let path = folder.join(name);
    std::fs::write(&path, content).expect("a file");
    path.to_str().expect("UTF-8").to_owned()
}

#[test]
fn wrong_arguments_end_with_64() {
    let cases: [(&[&str], &str); 10] = [
        (&["run"], "required"),
        (&["run", SCENARIO, "--replan", "0"], "--replan"),
        (&["run", SCENARIO, "--observation", "lidar"], "lidar"),
        (&["run", SCENARIO, "--tracker", "magic"], "magic"),
        (&["run", SCENARIO, "--workers", "1000"], "--workers"),
        (&["run", SCENARIO, "--seed", "-1"], "-1"),
        (&["fly"], "fly"),
        (&["train", "sleep"], "sleep"),
        (&["serve", "router", "--log", "info=[loud"], "loud"),
        (&["--log", "info=[loud", "serve", "sim-server"], "loud"),
    ];
    for (arguments, says) in cases {
        refused(arguments, 64, says);
    }
}

#[test]
fn a_benchmark_refuses_privileges_and_exact_alignment_refuses_cut_chunks() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("out").display().to_string();
    for policy in ["route-follower", "log-replay"] {
        let arguments = ["run", SCENARIO, "--policy", policy, "--benchmark", "--out", &out];
        refused(&arguments, 1, "privileged");
    }
    let exact = |replan: &str| {
        let arguments = [SCENARIO, "--align", "exact", "--replan", replan, "--duration", "1"];
        crate::harness::drive(&arguments).episode(0).clone()
    };
    let cut = exact("5");
    assert_eq!(cut["status"], "aborted");
    assert!(crate::harness::text(&cut["reason"]).contains("not_aligned"), "{cut}");
    assert_eq!(exact("4")["status"], "completed");
}

#[test]
fn bad_scenario_files_are_refused_by_name() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let sound = std::fs::read_to_string(workspace().join(SCENARIO)).expect("the scenario");
    let out = folder.path().join("out");
    let out = out.to_str().expect("UTF-8");
    let cases: [(&str, Vec<u8>); 8] = [
        ("empty", Vec::new()),
        ("not-json", b"\x80\x04\x95".to_vec()),
        ("truncated", sound.as_bytes()[..sound.len() / 2].to_vec()),
        ("wrong-format", sound.replace("dreamstream-scenario", "other-scenario").into_bytes()),
        ("future-version", sound.replacen("\"version\": 2", "\"version\": 99", 1).into_bytes()),
        ("list", b"[]".to_vec()),
        ("deep", "[".repeat(100_000).into_bytes()),
        ("null-bytes", vec![0; 1000]),
    ];
    for (name, content) in cases {
        let path = write(folder.path(), &format!("{name}.scenario.json"), &content);
        refused(&["run", &path, "--no-pictures", "--out", out], 1, name);
    }
    refused(&["run", "no/such.scenario.json", "--out", out], 1, "no/such.scenario.json");
    refused(&["run", folder.path().join("absent").to_str().expect("UTF-8"), "--out", out], 1, "absent");
}

#[test]
fn bad_prompts_and_first_frames_are_refused_before_anything_starts() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let png = |name: &str, width_px: u32, height_px: u32| {
        let picture = RgbImage::filled(width_px, height_px, [90; 3]).encode(Encoding::Png).expect("encodes");
        write(folder.path(), name, &picture)
    };
    let (fits, square, small) = (png("fits.png", 160, 96), png("square.png", 96, 96), png("small.png", 80, 48));
    let text = write(folder.path(), "text.png", b"a road");
    let out = folder.path().join("out").display().to_string();
    let rear = format!("rear={fits}");
    let cases: [(&[&str], &str); 9] = [
        (&["--prompt", ""], "prompt has 0 bytes and 0 words: at least 1 word"),
        (&["--prompt", " "], "0 words"),
        (&["--first-frame", "no/such.png"], "read no/such.png"),
        (&["--first-frame", &text], "no PNG or JPEG picture"),
        (&["--first-frame", &square], "has 96×96 px: at least 160×96 px are expected"),
        (&["--first-frame", &small], "has 80×48 px: at least 160×96 px"),
        (&["--first-frame", &rear], "camera \"rear\": one of [\"front\"] is expected"),
        (&["--first-frame", &fits, "--first-frame", &fits], "given twice"),
        (&["--prompt", "rain", "--observation", "layout"], "are for the observation source \"dreamstream\""),
    ];
    for (arguments, says) in cases {
        refused(&[&["run", SCENARIO, "--out", &out][..], arguments].concat(), 1, says);
        assert!(!Path::new(&out).exists(), "{arguments:?} started something");
    }
}

#[test]
fn bad_logs_are_refused_and_the_others_still_import() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let logs = folder.path().join("logs");
    std::fs::create_dir(&logs).expect("a folder");
    let cases: [(&str, &[u8]); 6] = [
        ("system", b"cos\nsystem\n(S'touch /tmp/dreamstream-was-here'\ntR."),
        ("stack-global", b"\x80\x04\x8c\x05posix\x8c\x06system\x93\x8c\x02id\x85R."),
        ("truncated", b"\x80\x04\x95\xff\xff\x00\x00"),
        ("huge", b"\x80\x04\x8e\x00\x00\x00\x00\x02\x00\x00\x00x."),
        ("empty", b""),
        ("list", b"\x80\x04]."),
    ];
    for (name, content) in cases {
        write(&logs, &format!("{name}.pkl"), content);
        let path = logs.join(format!("{name}.pkl"));
        let out = folder.path().join("out");
        refused(&["import", "scenarionet", path.to_str().expect("UTF-8"), "-o", out.to_str().expect("UTF-8")], 1, name);
    }
    assert!(!Path::new("/tmp/dreamstream-was-here").exists(), "a pickle was executed");
}

#[test]
fn bad_weights_and_models_are_refused_by_name() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let config = std::fs::read_to_string(workspace().join("configs/models/cpu_train.toml")).expect("the model");
    let huge = [&(1u64 << 40).to_le_bytes()[..], b"{}"].concat();
    let claims = br#"{"a":{"dtype":"F32","shape":[1000000,1000000],"data_offsets":[0,4000000000000]}}"#;
    let claims = [&(claims.len() as u64).to_le_bytes()[..], claims].concat();
    let cases: [(&str, Vec<u8>); 5] = [
        ("empty", Vec::new()),
        ("text", b"weights".to_vec()),
        ("huge-header", huge),
        ("claims", claims),
        ("no-tensors", [&2u64.to_le_bytes()[..], b"{}"].concat()),
    ];
    for (name, content) in cases {
        let model = write(folder.path(), &format!("{name}.toml"), config.as_bytes());
        write(folder.path(), &format!("{name}.safetensors"), &content);
        let recording = folder.path().join("none.mcap");
        let bench = ["bench", SCENARIO, "--model", &model];
        refused(&bench, 1, "weights");
        refused(&["replay", recording.to_str().expect("UTF-8"), "--service", "vdm-worker"], 1, "none.mcap");
    }
}

struct Orchestrator(Child, String);

impl Drop for Orchestrator {
    fn drop(&mut self) {
        let _already_gone = self.0.kill();
        let _reaped = self.0.wait();
    }
}

fn orchestrator(folder: &Path) -> Orchestrator {
    let port = free_port();
    let listen = format!("control.listen=\"127.0.0.1:{port}\"");
    let journal = format!("journal.folder={:?}", folder.to_str().expect("UTF-8"));
    let mut command = dreamstream(&["serve", "orchestrator"]);
    for setting in ["bus.mode=\"peer\"", "bus.connect=[]", &listen, &journal] {
        command.args(["--set", setting]);
    }
    let child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the binary starts");
    Orchestrator(child, format!("http://127.0.0.1:{port}"))
}

async fn connect(address: &str) -> RunsClient<Channel> {
    for _ in 0..300 {
        if let Ok(channel) = Channel::from_shared(address.to_owned()).expect("an address").connect().await {
            return RunsClient::new(channel);
        }
        tokio::time::sleep(std::time::Duration::from_millis(50)).await;
    }
    panic!("the orchestrator does not answer at {address}");
}

fn sound_request() -> pb::SubmitRequest {
    let path = workspace().join(SCENARIO).canonicalize().expect("the scenario");
    let path = path.to_str().expect("UTF-8").to_owned();
    pb::SubmitRequest {
        client_id: "client".to_owned(),
        scenarios: vec![pb::ScenarioSource { source: Some(pb::scenario_source::Source::Path(path)) }],
        policies: vec!["constant-velocity".to_owned()],
        observations: vec![pb::ObservationSource::Layout.into()],
        appearances: Vec::new(),
        seeds: vec![0],
        settings: None,
    }
}

#[tokio::test]
async fn bad_requests_are_refused_and_the_orchestrator_lives() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let server = orchestrator(folder.path());
    let mut client = connect(&server.1).await;
    let with = |change: &dyn Fn(&mut pb::SubmitRequest)| {
        let mut request = sound_request();
        change(&mut request);
        request
    };
    let settings = |change: &dyn Fn(&mut pb::RunSettings)| {
        let mut settings = pb::RunSettings::default();
        change(&mut settings);
        Some(settings)
    };
    let given = |change: &dyn Fn(&mut pb::RunSettings)| {
        with(&|r| {
            r.observations = vec![pb::ObservationSource::Dreamstream.into()];
            r.settings = settings(change);
        })
    };
    let cases: Vec<(&str, pb::SubmitRequest)> = vec![
        ("client_id", with(&|r| r.client_id = "../../etc".to_owned())),
        ("client_id", with(&|r| r.client_id = String::new())),
        ("scenarios", with(&|r| r.scenarios.clear())),
        ("scenarios", with(&|r| r.scenarios = vec![pb::ScenarioSource { source: None }])),
        (
            "nowhere",
            with(&|r| {
                let path = pb::scenario_source::Source::Path("/nowhere.scenario.json".to_owned());
                r.scenarios = vec![pb::ScenarioSource { source: Some(path) }];
            }),
        ),
        ("policies", with(&|r| r.policies.clear())),
        ("policies", with(&|r| r.policies = vec!["a/../b".to_owned()])),
        ("observations", with(&|r| r.observations = vec![99])),
        ("appearances", with(&|r| r.appearances = vec!["disco".to_owned()])),
        ("are for the observation source", with(&|r| r.settings = settings(&|s| s.prompt = Some("rain".to_owned())))),
        ("prompt has 0 bytes", given(&|s| s.prompt = Some(String::new()))),
        ("no PNG or JPEG", given(&|s| s.first_frames = vec![pb::FirstFrame::default()])),
        ("tracker", with(&|r| r.settings = settings(&|s| s.tracker = "magic".to_owned()))),
        ("scorer", with(&|r| r.settings = settings(&|s| s.scorer = "crystal-ball".to_owned()))),
        ("score_profile", with(&|r| r.settings = settings(&|s| s.score_profile = "kind".to_owned()))),
        (
            "privileged",
            with(&|r| {
                r.policies = vec!["log-replay".to_owned()];
                r.settings = settings(&|s| s.benchmark = true);
            }),
        ),
        ("replan_period", with(&|r| r.settings = settings(&|s| s.replan_period = 4_000_000))),
        ("history", with(&|r| r.settings = settings(&|s| s.history = u32::MAX))),
    ];
    for (says, request) in cases {
        let status = client.submit(request).await.expect_err(says);
        assert_eq!(status.code(), Code::InvalidArgument, "{status}");
        assert!(status.message().contains(says), "{:?} does not say {says:?}", status.message());
    }
    let unknown = client.get(pb::GetRequest { run_id: "run-none".to_owned() }).await.expect_err("no such run");
    assert_eq!(unknown.code(), Code::NotFound);
    let accepted = client.submit(sound_request()).await.expect("a sound run is accepted").into_inner();
    let again = client.submit(sound_request()).await.expect("the same run again").into_inner();
    assert_eq!((accepted.episodes, again.existed, &accepted.run_id), (1, true, &again.run_id));
    let cancelled = client.cancel(pb::CancelRequest { run_id: accepted.run_id, reason: "test".to_owned() }).await;
    assert_eq!(cancelled.expect("cancelled").into_inner().episodes.len(), 1);
}

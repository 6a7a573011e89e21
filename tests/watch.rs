//! Looking on at a running fleet. `gap watch`: what it puts on the bus, what it says where there is nothing to diagnose, and
//! that topic `diagnosis` never gets in a drive's way. `top`: who works, who was killed.

use std::path::Path;
use std::process::{Child, Output};
use std::sync::LazyLock;

use crate::fleet::{Fleet, WORKER};
use crate::harness::{dreamstream, drive, text, wait_for};
use ds_bus::{BusSession, BusSettings, Mode, Subscription};
use ds_record::Recording;
use ds_space::{EpisodeId, InstanceId, SimTime, Tick};
use ds_topic::{DiagnosedEffect, Diagnosis, Envelope, Slot, Topic};
use ds_wire::{Body, verify};
use tokio::runtime::Runtime;

const SCENARIO: &str = "scenarios/base/free-curve.scenario.json";
const DRIVE: [&str; 5] = [SCENARIO, "--policy", "lattice", "--observation", "reference"];

/// Drives to their end by a policy that brakes and turns.
const BRISK: [&str; 7] = ["--policy", "expert", "--observation", "layout", "--duration", "0", "--vehicle-log"];

/// What the bus of a test runs on.
static RUNTIME: LazyLock<Runtime> = LazyLock::new(|| Runtime::new().expect("a runtime"));

impl Fleet {
    fn watch(&self, more: &[&str], log: &str) -> Child {
        let (router, orchestrator) = (self.endpoint(), self.orchestrator());
        let reach = ["gap", "watch", "--bus", &router, "--orchestrator", &orchestrator];
        let child = self.spawn(&[&reach[..], more].concat(), log);
        // a drive that is over before the watch looks for it is never seen
        wait_for("the watch", 60, || self.log(log).contains("waiting for").then_some(()));
        child
    }

    fn submit(&self, more: &[&str]) -> Output {
        self.submit_all(&[&DRIVE, more].concat())
    }

    fn submit_all(&self, words: &[&str]) -> Output {
        let (orchestrator, out) = (self.orchestrator(), self.path("out").display().to_string());
        let to = ["submit", "--orchestrator", &orchestrator, "--out", &out];
        dreamstream(&[&to[..], words].concat()).output().expect("the binary runs")
    }

    fn join(&self) -> BusSession {
        let settings = BusSettings { mode: Mode::Client, connect: vec![self.endpoint()], ..BusSettings::default() };
        RUNTIME.block_on(BusSession::open(&settings)).expect("the router answers")
    }

    fn listen(&self, bus: &BusSession, episode: &EpisodeId, topic: Topic) -> Subscription {
        RUNTIME.block_on(bus.subscribe(episode, &[topic])).expect("the session is open")
    }

    fn recording(&self, episode: &EpisodeId) -> Recording {
        let path = self.path("runs").join("recordings").join(format!("{episode}.a1.mcap"));
        Recording::open(&path).expect("a recording")
    }
}

fn episode(seed: u32) -> EpisodeId {
    EpisodeId::new(&format!("free-curve.lattice.reference.s{seed}")).expect("an id")
}

fn ended(child: &mut Child) -> std::process::ExitStatus {
    wait_for("the end of the watch", 180, || child.try_wait().expect("a child"))
}

/// Returns the lines of JSON that a watch wrote.
fn lines(path: &Path) -> Vec<serde_json::Value> {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    text.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect()
}

/// Waits for as many diagnoses as were put and checks what must hold of all of them.
fn heard(subscription: &mut Subscription, put: usize) -> Vec<(Envelope, Diagnosis)> {
    let mut heard = Vec::new();
    wait_for("every diagnosis", 30, || {
        heard.extend(std::iter::from_fn(|| subscription.try_recv()));
        (heard.len() >= put).then_some(())
    });
    let bodies = heard.iter().map(|envelope| verify::<Diagnosis>(envelope).expect("a sound message"));
    let heard: Vec<_> = bodies.zip(&heard).map(|(body, envelope)| (envelope.clone(), body)).collect();
    for (number, (envelope, body)) in heard.iter().enumerate() {
        assert_eq!((envelope.header.sequence, envelope.header.slot.index), (number as u64, envelope.header.tick.0));
        assert!((body.window.1.secs() - envelope.header.time.secs()).abs() < 0.11, "{:?}", body.window);
        assert!((6.0..=20.1).contains(&(body.window.1.secs() - body.window.0.secs())), "{:?}", body.window);
        let sum = body.p_none + body.p_unknown + body.effects.iter().map(|effect| effect.probability).sum::<f64>();
        assert!((sum - 1.0).abs() < 0.02, "probabilities sum to {sum}");
    }
    assert!(heard.windows(2).all(|pair| pair[0].0.header.tick < pair[1].0.header.tick), "out of order");
    heard
}

/// Returns the likeliest effect of the last window.
fn named(heard: &[(Envelope, Diagnosis)]) -> &DiagnosedEffect {
    heard.last().and_then(|(_, body)| body.effects.first()).expect("an effect")
}

#[test]
fn a_drive_is_diagnosed_on_the_bus_while_it_goes_on() {
    let fleet = Fleet::start(1);
    let bus = fleet.join();
    let mut diagnoses = fleet.listen(&bus, &episode(3), Topic::Diagnosis);
    let file = fleet.path("lines.json");
    let mut watch = fleet.watch(&["-o", &file.display().to_string()], "watch.log");
    let driven = fleet.submit(&["--seed", "3", "--effect", "gyro_bias=0.02", "--vehicle-log"]);
    assert!(driven.status.success(), "{}", String::from_utf8_lossy(&driven.stderr));
    let status = ended(&mut watch);
    let said = fleet.log("watch.log");
    assert!(status.success() && said.contains("watching free-curve.lattice.reference.s3"), "{said}");
    let told = lines(&file);
    assert!(!told.is_empty(), "{said}");
    let heard = heard(&mut diagnoses, told.len());
    assert_eq!(heard.len(), told.len(), "{said}");
    assert!(heard.iter().all(|(_, body)| body.reference.is_empty() && body.differences.is_empty()));
    let found = named(&heard);
    assert_eq!(found.id, "gyro_bias", "{said}");
    assert!(found.value.is_some_and(|value| (value - 0.02).abs() < 0.005), "{found:?}");
    // What came before the end is in the recording, as it was put.
    let recording = fleet.recording(&episode(3));
    assert!(recording.missing().expect("orders decode").is_empty());
    for envelope in recording.topic(Topic::Diagnosis) {
        assert!(heard.iter().any(|(put, _)| put == envelope), "{:?} was never put", envelope.header);
    }

    // Without a vehicle log there is nothing to diagnose: the watch says so and ends; the drive goes on.
    let mut watch = fleet.watch(&["s4"], "bare.log");
    let driven = fleet.submit(&["--seed", "4", "--duration", "8"]);
    assert!(driven.status.success(), "{}", String::from_utf8_lossy(&driven.stderr));
    let (status, said) = (ended(&mut watch), fleet.log("bare.log"));
    assert!(!status.success() && said.contains("no vehicle log") && said.contains("--vehicle-log"), "{said}");
}

#[test]
fn a_healthy_drive_is_watched_against_a_baseline_and_not_diagnosed() {
    let fleet = Fleet::start(1);
    let path = |name: &str| fleet.path(name).display().to_string();
    let run = |arguments: &[&str]| {
        let output = dreamstream(arguments).output().expect("the binary runs");
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    };
    let names = ["11", "12", "13"].map(|seed| (seed, path(&format!("day-{seed}"))));
    for (seed, out) in &names {
        run(&[&["run", "--out", out, "--seed", seed, "--vehicle-log", "--no-pictures"][..], &DRIVE].concat());
    }
    let logs = names.each_ref().map(|(_, out)| format!("{out}/real"));
    let [baseline, lines_at] = ["baseline.json", "lines.json"].map(path);
    run(&["gap", "baseline", &logs[0], &logs[1], &logs[2], "-o", &baseline]);

    let mut watch = fleet.watch(&["s14", "--baseline", &baseline, "-o", &lines_at], "watch.log");
    let driven = fleet.submit(&["--seed", "14", "--vehicle-log"]);
    assert!(driven.status.success(), "{}", String::from_utf8_lossy(&driven.stderr));
    let (status, said) = (ended(&mut watch), fleet.log("watch.log"));
    assert!(status.success() && said.contains("windows judged against the baseline"), "{said}");
    assert!(lines(Path::new(&lines_at)).is_empty() && said.contains("0 windows diagnosed"), "{said}");
    let refused = ["gap", "watch", "s1", "--baseline", &baseline, "--reference", "s2"];
    let refused = dreamstream(&refused).output().expect("the binary runs");
    assert!(String::from_utf8_lossy(&refused.stderr).contains("leave --reference out"), "{refused:?}");
}

/// Drives four scenarios to their end; returns the folder of the vehicle logs.
fn driven(fleet: &Fleet, seed: &str, effects: &[&str]) -> String {
    let out = fleet.path(&format!("run-{seed}")).display().to_string();
    let scenarios = ["cut-in", "lead-braking", "roundabout", "unprotected-left"];
    let scenarios = scenarios.map(|name| format!("scenarios/base/{name}.scenario.json"));
    let how = [&BRISK[..], &["--no-pictures"]].concat();
    let named = scenarios.iter().map(String::as_str).chain(["--seed", seed, "--out", &out]);
    let words: Vec<&str> = std::iter::once("run").chain(named).chain(how).chain(effects.iter().copied()).collect();
    let output = dreamstream(&words).output().expect("the binary runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    format!("{out}/real")
}

#[test]
fn healthy_drives_stay_within_the_rate_and_what_is_switched_on_is_told_across_drives() {
    let fleet = Fleet::start(1);
    let [baseline, report, lines_at] =
        ["baseline.json", "report.json", "lines.json"].map(|name| fleet.path(name).display().to_string());
    let run = |arguments: &[&str]| {
        let output = dreamstream(arguments).output().expect("the binary runs");
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    };
    let healthy = ["7404", "7405", "7406"].map(|seed| driven(&fleet, seed, &[]));
    run(&["gap", "baseline", &healthy[0], &healthy[1], &healthy[2], "-o", &baseline]);
    let watched = |rate: &str, logs: &[&str]| -> serde_json::Value {
        let how = ["--baseline", &baseline, "--alarms-per-hour", rate, "--alarms-only", "-o", &report];
        run(&[&["gap", "watch"][..], logs, &how].concat());
        serde_json::from_str(&std::fs::read_to_string(&report).expect("a report")).expect("JSON")
    };
    // two minutes at sixty an hour: two are allowed, and chance gives five in one of sixty such draws
    let others = ["7407", "7408"].map(|seed| driven(&fleet, seed, &[]));
    let said = watched("60", &[&others[0], &others[1]]);
    let (alarms, hours) = (&said["alarms"].as_array().expect("a list"), said["hours"].as_f64().expect("hours"));
    assert!(hours > 0.03 && alarms.len() <= 4, "{said}");
    let broken = driven(&fleet, "7409", &["--effect", "gyro_bias=0.02"]);
    let said = watched("1", &[&others[0], &broken]);
    let first = &said["alarms"][0];
    let told_after = 3600.0 * first["hours"].as_f64().expect("hours") - 0.5 * 3600.0 * hours;
    assert!((0.0..30.0).contains(&told_after) && first["channels"][0][0] == "yaw_rate", "{said}");

    // one drive has too few windows for an alarm at one an hour, two have enough; they are like the healthy ones
    let more = ["roundabout", "--baseline", &baseline, "--drives", "2", "-o", &lines_at];
    let mut watch = fleet.watch(&more, "watch.log");
    for seed in ["31", "32"] {
        let what = ["scenarios/base/roundabout.scenario.json", "--seed", seed, "--effect", "gyro_bias=0.02"];
        let driven = fleet.submit_all(&[&what[..], &BRISK].concat());
        assert!(driven.status.success(), "{}", String::from_utf8_lossy(&driven.stderr));
        if seed == "31" {
            wait_for("the end of the first", 60, || {
                fleet.log("watch.log").contains("waiting for drive 2").then_some(())
            });
            assert!(lines(Path::new(&lines_at)).is_empty(), "{}", fleet.log("watch.log"));
        }
    }
    let (status, said) = (ended(&mut watch), fleet.log("watch.log"));
    let told = lines(Path::new(&lines_at));
    assert!(status.success() && said.contains("waiting for drive 2") && !told.is_empty(), "{said}");
    assert_eq!(told[0]["alarm"]["channels"][0][0], "yaw_rate", "{said}");
    assert!(told.last().is_some_and(|line| line["diagnosis"].is_object()), "from the alarm on: {said}");
}

#[test]
fn top_sees_who_works_and_who_was_killed() {
    let mut fleet = Fleet::start(1);
    let orchestrator = fleet.orchestrator();
    let top = || {
        let output = dreamstream(&["top", "--once", "--json", "--orchestrator", &orchestrator]).output().expect("runs");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice::<serde_json::Value>(&output.stdout).expect("JSON")
    };
    let states = |told: &serde_json::Value| {
        let members = told["members"].as_array().expect("members").iter();
        members.map(|member| (text(&member["role"]), text(&member["state"]))).collect::<Vec<_>>()
    };
    wait_for("four members", 60, || (states(&top()).len() == 4).then_some(()));
    let out = fleet.path("out").display().to_string();
    let submit = ["submit", "--orchestrator", &orchestrator, "--out", &out];
    let mut driven =
        fleet.spawn(&[&submit[..], &DRIVE, &["--seed", "5", "--seed", "6", "--seed", "7"]].concat(), "submit.log");
    wait_for("a member at work", 60, || states(&top()).iter().any(|(_, state)| state == "works").then_some(()));
    assert!(driven.wait().expect("it ends").success(), "{}", fleet.log("submit.log"));
    let told = top();
    assert_eq!(told["runs"][0]["by_status"]["completed"], 3, "{told}");
    fleet.children[WORKER].kill().expect("it runs");
    let seen = wait_for("the kill", 5, || {
        let of_video: Vec<_> = states(&top()).into_iter().filter(|(role, _)| role == "video").collect();
        of_video.iter().all(|(_, state)| state != "works" && state != "idle").then_some(of_video)
    });
    assert!(seen.iter().all(|(_, state)| state == "lost its line" || state == "silent"), "{seen:?}");
    let shown = dreamstream(&["top", "--once", "--orchestrator", &orchestrator]).output().expect("runs");
    let shown = String::from_utf8_lossy(&shown.stdout).into_owned();
    assert!(shown.contains("layout") && shown.contains("3 completed"), "{shown}");
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let unread = dreamstream(&["top", "--orchestrator", &orchestrator]).stdout(writer).status();
    assert!(unread.expect("runs").success(), "it ends where nobody reads on");
}

#[test]
fn a_reference_log_counts_as_real() {
    let real = drive(&[&DRIVE[..], &["--effect", "gyro_bias=0.02", "--vehicle-log"]].concat());
    assert!(real.output.status.success(), "{}", String::from_utf8_lossy(&real.output.stderr));
    let log = real.folder.path().join("real/free-curve.mcap").display().to_string();
    let fleet = Fleet::start(1);
    let bus = fleet.join();
    let mut diagnoses = fleet.listen(&bus, &episode(0), Topic::Diagnosis);
    let file = fleet.path("lines.json");
    let mut watch = fleet.watch(&["--reference", &log, "-o", &file.display().to_string()], "watch.log");
    let driven = fleet.submit(&["--vehicle-log"]);
    assert!(driven.status.success(), "{}", String::from_utf8_lossy(&driven.stderr));
    let (status, said) = (ended(&mut watch), fleet.log("watch.log"));
    assert!(status.success(), "{said}");
    let heard = heard(&mut diagnoses, lines(&file).len());
    assert_eq!(named(&heard).id, "gyro_bias", "{said}");
    let (_, last) = heard.last().expect("some");
    assert_eq!(last.reference, "free-curve.mcap");
    let yaw_rate = last.differences.iter().find(|(channel, _)| channel == "yaw_rate").expect("a difference").1;
    // The policy steers by the gyro, so that its zero leads the reference astray.
    assert!((0.015..0.2).contains(&yaw_rate), "{:?}", last.differences);
}

fn made_up(tick: u32, p_none: f64) -> Diagnosis {
    Diagnosis {
        window: (SimTime(0), SimTime::at(Tick(tick), SimTime::from_secs(0.1))),
        reference: String::new(),
        verdict: ds_effect::Verdict::None,
        p_none,
        p_unknown: 0.0,
        effects: Vec::new(),
        cells: Vec::new(),
        differences: Vec::new(),
    }
}

#[test]
fn what_is_put_beside_a_drive_is_recorded_and_costs_it_nothing() {
    let alone = drive(&[&DRIVE[..], &["--duration", "4"]].concat());
    let fleet = Fleet::start(1);
    let bus = fleet.join();
    let mut worlds = fleet.listen(&bus, &episode(0), Topic::World);
    let putting = RUNTIME.spawn(async move {
        let world = worlds.recv().await.header;
        let put = |tick: u32, body: &Diagnosis, spoil: bool| {
            let mut message = Envelope { header: world.clone(), body: body.to_bytes() };
            message.header.publisher = InstanceId::new("gap-test").expect("an id");
            message.header.tick = Tick(tick);
            message.header.slot = Slot::new(Topic::Diagnosis, tick);
            message.header.content = body.content();
            if spoil {
                message.body = message.body.slice(..message.body.len() / 2);
            }
            message
        };
        let messages = [
            put(3, &made_up(3, 1.0), false),
            put(3, &made_up(3, 0.5), false),
            put(4, &made_up(4, 1.0), true),
            put(9_999, &made_up(9_999, 1.0), false),
        ];
        for message in &messages {
            bus.publish(message).await.expect("the session is open");
        }
        // Kept open until the drive has ended.
        bus
    });
    let driven = fleet.submit(&["--duration", "4"]);
    assert!(driven.status.success(), "{}", String::from_utf8_lossy(&driven.stderr));
    let _bus = RUNTIME.block_on(putting).expect("all were put");
    let results = std::fs::read_to_string(fleet.path("out/results.json")).expect("results");
    let results: serde_json::Value = serde_json::from_str(&results).expect("JSON");
    let digest = |episode: &serde_json::Value| episode["world_digest"].clone();
    assert_eq!(digest(&results["episodes"][0]), digest(alone.episode(0)));
    let recording = fleet.recording(&episode(0));
    let kept: Vec<u32> = recording.topic(Topic::Diagnosis).map(|envelope| envelope.header.slot.index).collect();
    assert_eq!(kept, [3]);
    let body: Diagnosis = recording.body(Slot::new(Topic::Diagnosis, 3)).expect("can be read");
    assert_eq!(body, made_up(3, 1.0));
}

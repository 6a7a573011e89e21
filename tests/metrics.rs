//! What a fleet tells Prometheus: counts that agree with results, a killed worker that is seen, names that manual and dashboard
//! know; and that it costs a drive nothing.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{Read, Write};
use std::net::TcpStream;

use crate::fleet::{Fleet, WORKER};
use crate::harness::{drive, free_port, start, wait_for, workspace};
use serde_json::Value;

const SCENARIO: &str = "scenarios/base/free-curve.scenario.json";
const DRIVE: [&str; 5] = [SCENARIO, "--policy", "lattice", "--observation", "reference"];
const PREFIX: &str = "dreamstream_";

/// One answer to a scrape.
#[derive(Debug, Default)]
struct Page {
    /// Kinds by family.
    kinds: BTreeMap<String, String>,
    /// Values by name with labels.
    samples: BTreeMap<String, f64>,
}

impl Page {
    /// Asks the process behind a port; `None` if it does not answer.
    fn of(port: u16) -> Option<Self> {
        let mut stream = TcpStream::connect(("127.0.0.1", port)).ok()?;
        let mut text = String::new();
        stream.write_all(b"GET /metrics HTTP/1.0\r\n\r\n").ok()?;
        stream.read_to_string(&mut text).ok()?;
        let (head, body) = text.split_once("\r\n\r\n")?;
        assert!(head.starts_with("HTTP/1.0 200") && head.contains("text/plain; version=0.0.4"), "{head}");
        let mut page = Self::default();
        for line in body.lines() {
            if let Some((family, kind)) = line.strip_prefix("# TYPE ").and_then(|told| told.split_once(' ')) {
                page.kinds.insert(family.to_owned(), kind.to_owned());
            } else if !line.starts_with('#') {
                let (sample, value) = line.rsplit_once(' ').expect("a value");
                page.samples.insert(sample.to_owned(), value.parse().expect("a number"));
            }
        }
        Some(page)
    }

    /// Returns the sum of a family's samples whose labels hold all of `labels`.
    fn sum(&self, name: &str, labels: &[&str]) -> f64 {
        let of_family = |sample: &str| sample.split('{').next() == Some(name);
        let matching = self.samples.iter().filter(|(sample, _)| of_family(sample));
        let matching = matching.filter(|(sample, _)| labels.iter().all(|label| sample.contains(label)));
        let values: Vec<f64> = matching.map(|(_, value)| *value).collect();
        assert!(!values.is_empty(), "no {name} with {labels:?}");
        values.iter().sum()
    }

    /// Returns the values that may only grow.
    fn growing(&self) -> BTreeMap<String, f64> {
        let grows = |sample: &str| {
            let name = sample.split('{').next().unwrap_or_default();
            let of_histogram = ["_bucket", "_sum", "_count"].iter().filter_map(|suffix| name.strip_suffix(suffix));
            of_histogram
                .chain([name])
                .any(|family| matches!(self.kinds.get(family).map(String::as_str), Some("counter" | "histogram")))
        };
        self.samples
            .iter()
            .filter(|(sample, _)| grows(sample))
            .map(|(sample, value)| (sample.clone(), *value))
            .collect()
    }
}

/// Looks at a fleet again and again; fails where a count fell or is gone.
#[derive(Default)]
struct Watcher(BTreeMap<u16, BTreeMap<String, f64>>);

impl Watcher {
    fn look(&mut self, port: u16) -> Option<Page> {
        let page = Page::of(port)?;
        let growing = page.growing();
        for (sample, before) in self.0.insert(port, growing.clone()).into_iter().flatten() {
            assert!(
                growing.get(&sample).is_some_and(|now| *now >= before),
                "{sample} was {before}: {:?}",
                growing.get(&sample)
            );
        }
        Some(page)
    }

    fn all(&mut self, fleet: &Fleet) -> Vec<Page> {
        fleet.metrics[1..].iter().map(|port| self.look(*port).expect("every service answers")).collect()
    }
}

/// Starts drives of some seeds on a fleet.
fn submit(fleet: &Fleet, name: &str, seeds: std::ops::Range<u32>) -> std::process::Child {
    let (orchestrator, out) = (fleet.orchestrator(), fleet.path(name).display().to_string());
    let mut arguments = vec!["submit", "--orchestrator", &orchestrator, "--out", &out];
    arguments.extend(DRIVE);
    let seeds: Vec<String> = seeds.map(|seed| seed.to_string()).collect();
    seeds.iter().for_each(|seed| arguments.extend(["--seed", seed]));
    fleet.spawn(&arguments, &format!("{name}.log"))
}

fn episodes(fleet: &Fleet, name: &str) -> Vec<Value> {
    let results = std::fs::read_to_string(fleet.path(name).join("results.json")).expect("results");
    let results: Value = serde_json::from_str(&results).expect("results are JSON");
    let episodes = results["episodes"].as_array().expect("episodes").clone();
    assert!(episodes.iter().all(|episode| episode["status"] == "completed"), "{episodes:?}");
    episodes
}

/// Returns ticks and iterations of episodes as results tell them, the replan period being the default.
fn driven(episodes: &[Value]) -> (f64, f64) {
    let ticks = episodes.iter().map(|episode| episode["ticks"].as_u64().expect("ticks"));
    let (ticks, iterations) =
        ticks.fold((0, 0), |(all, iterations), ticks| (all + ticks, iterations + 1 + ticks.div_ceil(5)));
    (ticks as f64, iterations as f64)
}

/// Returns every name of a metric in a text.
fn names(text: &str) -> BTreeSet<String> {
    let tail = |text: &str| text.chars().take_while(|c| c.is_ascii_lowercase() || *c == '_').collect::<String>();
    text.split(PREFIX).skip(1).map(|rest| format!("{PREFIX}{}", tail(rest))).collect()
}

/// All names that are told stand in the manual, and the other way round; the dashboard asks for no other.
fn names_agree(pages: &[Page]) {
    let told: BTreeSet<String> = pages.iter().flat_map(|page| page.kinds.keys().cloned()).collect();
    let read = |path: &str| std::fs::read_to_string(workspace().join(path)).expect("a file");
    let family = |name: String| {
        let base = ["_bucket", "_sum", "_count"].iter().find_map(|suffix| name.strip_suffix(suffix));
        base.filter(|base| told.contains(*base)).map_or(name.clone(), str::to_owned)
    };
    let in_manual: BTreeSet<String> = names(&read("docs/metrics.md")).into_iter().map(family).collect();
    assert_eq!(told, in_manual, "docs/metrics.md and the exposition differ");
    let dashboard: Value = serde_json::from_str(&read("deploy/metrics/dashboard.json")).expect("JSON");
    let panels = dashboard["panels"].as_array().expect("panels").iter();
    let queries = panels.flat_map(|panel| panel["targets"].as_array().into_iter().flatten());
    let asked: Vec<&str> = queries.map(|target| target["expr"].as_str().expect("a query")).collect();
    let unknown: Vec<String> =
        names(&asked.join(" ")).into_iter().map(family).filter(|name| !told.contains(name)).collect();
    assert!(unknown.is_empty() && asked.len() > 20, "nobody tells {unknown:?}, {} queries", asked.len());
}

#[test]
fn counts_agree_with_results_and_a_killed_worker_is_seen() {
    let mut fleet = Fleet::start(2);
    let mut watcher = Watcher::default();
    let orchestrator = fleet.metrics[1];
    let video = |page: &Page, state: &str| {
        page.sum("dreamstream_instances", &["role=\"video\"", &format!("state=\"{state}\"")])
    };
    wait_for("two idle workers", 60, || watcher.look(orchestrator).filter(|page| video(page, "idle") == 2.0));

    let mut first = submit(&fleet, "first", 0..6);
    let pages = wait_for("the end of the drives", 120, || {
        let pages = watcher.all(&fleet);
        first.try_wait().expect("a child").map(|status| (status, pages))
    });
    assert!(pages.0.success(), "{}", fleet.log("first.log"));
    let pages = watcher.all(&fleet);
    let episodes_driven = episodes(&fleet, "first");
    let (ticks, iterations) = driven(&episodes_driven);
    let orchestrated = &pages[0];
    for (name, labels, value) in [
        ("dreamstream_episodes", &["completed"][..], 6.0),
        ("dreamstream_episodes", &[], 6.0),
        ("dreamstream_attempts_total", &["completed"], 6.0),
        ("dreamstream_attempts_total", &[], 6.0),
        ("dreamstream_ticks_total", &[], ticks),
        ("dreamstream_iterations_total", &[], iterations),
        ("dreamstream_iteration_seconds_count", &[], iterations),
        ("dreamstream_iteration_overhead_seconds_count", &[], iterations),
        ("dreamstream_commit_seconds_count", &[], iterations),
        ("dreamstream_leases_total", &["video"], 6.0),
        ("dreamstream_lost_leases_total", &[], 0.0),
        ("dreamstream_deadline_misses_total", &[], 0.0),
        ("dreamstream_recovery_seconds_count", &[], 0.0),
    ] {
        assert_eq!(orchestrated.sum(name, labels), value, "{name} {labels:?}");
    }
    let over_workers = |name: &str| pages.iter().skip(WORKER - 1).map(|page| page.sum(name, &[])).sum::<f64>();
    assert_eq!(over_workers("dreamstream_frames_total"), ticks + 6.0);
    assert_eq!(over_workers("dreamstream_order_seconds_count"), iterations);
    assert_eq!(over_workers("dreamstream_cache_hits_total"), iterations - 6.0);
    let wall: f64 = episodes_driven.iter().filter_map(|episode| episode["wall_s"].as_f64()).sum();
    let took = orchestrated.sum("dreamstream_iteration_seconds_sum", &[]);
    let overhead = orchestrated.sum("dreamstream_iteration_overhead_seconds_sum", &[]);
    assert!(0.0 < overhead && overhead < took && took < wall, "{overhead} of {took} of {wall} s");

    names_agree(&pages);

    // A worker that holds a role is killed: the next looks see it, its page is gone, the drives are driven to their end.
    let mut second = submit(&fleet, "second", 6..14);
    let hits = |page: &Page| page.sum("dreamstream_cache_hits_total", &[]);
    let killed = wait_for("a worker in the middle of a drive", 60, || {
        [WORKER, WORKER + 1].into_iter().find(|index| {
            let page = Page::of(fleet.metrics[*index]).expect("answers");
            page.sum("dreamstream_held_roles", &[]) > 0.0 && hits(&page) > hits(&pages[index - 1])
        })
    });
    fleet.children[killed].kill().expect("it runs");
    let seen =
        wait_for("the loss", 5, || watcher.look(orchestrator).filter(|page| video(page, "lost its line") == 1.0));
    assert_eq!(video(&seen, "works") + video(&seen, "idle"), 1.0);
    assert!(Page::of(fleet.metrics[killed]).is_none(), "a dead worker answers");
    let fenced = wait_for("the end of its leases", 60, || {
        watcher.look(orchestrator).filter(|page| page.sum("dreamstream_lost_leases_total", &["video", "died"]) > 0.0)
    });
    assert_eq!(fenced.sum("dreamstream_instances", &["video"]), 1.0, "it is no member any more");
    let ended = wait_for("the end of the drives", 180, || second.try_wait().expect("a child"));
    assert!(ended.success(), "{}", fleet.log("second.log"));
    let last = watcher.look(orchestrator).expect("answers");
    let (more_ticks, more_iterations) = driven(&episodes(&fleet, "second"));
    let lost = last.sum("dreamstream_lost_leases_total", &[]);
    for (name, value) in [
        ("dreamstream_ticks_total", ticks + more_ticks),
        ("dreamstream_iterations_total", iterations + more_iterations),
        ("dreamstream_episodes", 14.0),
        ("dreamstream_recovery_seconds_count", lost),
        ("dreamstream_attempts_total", 14.0),
    ] {
        assert_eq!(last.sum(name, &[]), value, "{name}");
    }
    assert_eq!(last.sum("dreamstream_protocol_reassignments_total", &["orchestrator"]), lost);
    let survivor = watcher.look(fleet.metrics[2 * WORKER + 1 - killed]).expect("answers");
    assert!(
        survivor.sum("dreamstream_restore_seconds_count", &[]) >= 1.0,
        "whoever took over found the state in memory"
    );
}

#[test]
fn a_run_in_one_process_tells_of_all_roles_and_drives_the_same() {
    let drives = [&DRIVE[..], &["--seed", "1", "--seed", "2"]].concat();
    let alone = drive(&drives);
    let port = free_port();
    let folder = tempfile::tempdir().expect("a temporary folder");
    let address = format!("127.0.0.1:{port}");
    let mut watched = start(&[&drives[..], &["--metrics", &address]].concat(), folder.path());
    let (mut watcher, mut last) = (Watcher::default(), None);
    let status = wait_for("the end of the run", 120, || {
        last = watcher.look(port).or(last.take());
        watched.try_wait().expect("a child")
    });
    assert!(status.success());
    let page = last.expect("it answered");
    assert_eq!(page.sum("dreamstream_build_info", &["service=\"run\""]), 1.0);
    for role in ["sim", "layout", "video", "policy", "orchestrator"] {
        page.sum("dreamstream_protocol_pulls_total", &[&format!("role=\"{role}\"")]);
    }
    let output = std::process::Output { status, stdout: Vec::new(), stderr: Vec::new() };
    let watched = crate::harness::finished(folder, output);
    assert_eq!([0, 1].map(|index| alone.digests(index)), [0, 1].map(|index| watched.digests(index)));
}

#[test]
fn a_benchmark_tells_while_it_drives() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = |name: &str| folder.path().join(name).to_str().expect("UTF-8").to_owned();
    let build = ["benchmark", "build", "base", "--unfiltered", "--candidates", "3", "--seed", "11", "--out"];
    assert!(
        crate::harness::dreamstream(&[&build[..], &[&path("sets")]].concat())
            .status()
            .expect("the binary runs")
            .success()
    );
    let (port, set) = (free_port(), path("sets/town.set.json"));
    let address = format!("127.0.0.1:{port}");
    let run =
        ["benchmark", "run", &set, "--policy", "lattice", "--observation", "layout", "--metrics", &address, "--out"];
    let mut child =
        crate::harness::dreamstream(&[&run[..], &[&path("out")]].concat()).spawn().expect("the binary runs");
    let (mut watcher, mut last) = (Watcher::default(), None);
    let status = wait_for("the end of the benchmark", 120, || {
        last = watcher.look(port).or(last.take());
        child.try_wait().expect("a child")
    });
    assert!(status.success());
    let page = last.expect("it answered");
    assert_eq!(page.sum("dreamstream_build_info", &["service=\"run\""]), 1.0);
    page.sum("dreamstream_protocol_pulls_total", &["role=\"orchestrator\""]);
}

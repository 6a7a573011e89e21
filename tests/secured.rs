//! A fleet as on a network: certificates, token, rights on the bus, and devices that are handed out once.

use std::path::{Path, PathBuf};
use std::process::{Child, Output};

use crate::harness::{dreamstream, free_port, wait_for};

const SCENARIO: &str = "scenarios/base/free-curve.scenario.json";

/// A fleet of child processes that all speak TLS; killed when dropped.
struct Secured {
    folder: tempfile::TempDir,
    bus: u16,
    control: u16,
    children: Vec<Child>,
}

impl Drop for Secured {
    fn drop(&mut self) {
        for child in &mut self.children {
            let _gone = child.kill();
            let _waited = child.wait();
        }
    }
}

impl Secured {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        certs(&folder.path().join("certs"));
        Self { folder, bus: free_port(), control: free_port(), children: Vec::new() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Starts a service under a certificate; its log goes to `log`.
    fn serve(&mut self, service: &str, certs: &Path, log: &str, more: &[String]) {
        let file = |name: &str| certs.join(name).display().to_string();
        let mut settings = vec![
            format!("security.ca={:?}", file("ca.pem")),
            format!("security.certificate={:?}", file(&format!("{service}.pem"))),
            format!("security.key={:?}", file(&format!("{service}.key"))),
        ];
        if service != "router" {
            settings.push(format!("security.token={:?}", file("token")));
            settings.push(format!("bus.connect=[\"tls/127.0.0.1:{}\"]", self.bus));
        }
        if !["router", "orchestrator"].contains(&service) {
            settings.push(format!("control.orchestrator=\"https://127.0.0.1:{}\"", self.control));
        }
        settings.extend_from_slice(more);
        let mut arguments = vec!["serve", service];
        settings.iter().for_each(|setting| arguments.extend(["--set", setting.as_str()]));
        let log = std::fs::File::create(self.path(log)).expect("a log file");
        let out = log.try_clone().expect("a second handle");
        self.children.push(dreamstream(&arguments).stderr(log).stdout(out).spawn().expect("the service starts"));
    }

    fn start(&mut self) {
        let certs = self.path("certs");
        let listen = format!("bus.listen=[\"tls/127.0.0.1:{}\"]", self.bus);
        let router = ["bus.mode=\"router\"".to_owned(), "bus.connect=[]".to_owned(), listen];
        self.serve("router", &certs, "router.log", &router);
        wait_for_port(self.bus);
        let journal = format!("journal.folder={:?}", self.path("runs").display().to_string());
        let control = [format!("control.listen=\"127.0.0.1:{}\"", self.control), journal];
        self.serve("orchestrator", &certs, "orchestrator.log", &control);
        wait_for_port(self.control);
        for service in ["sim-server", "layout-render", "policy-bridge"] {
            self.serve(service, &certs, &format!("{service}.log"), &[]);
        }
        // Two workers and one device: whoever comes second is told so and goes on asking.
        for log in ["worker-0.log", "worker-1.log"] {
            self.serve("vdm-worker", &certs, log, &["video.devices=[\"gpu-0\"]".to_owned()]);
        }
    }

    fn ask(&self, arguments: &[&str], certs: &Path, token: &str) -> Output {
        let orchestrator = format!("https://127.0.0.1:{}", self.control);
        let (ca, token) = (certs.join("ca.pem").display().to_string(), self.path(token).display().to_string());
        let reach = ["--orchestrator", &orchestrator, "--ca", &ca, "--token", &token];
        dreamstream(&[arguments, &reach].concat()).output().expect("the binary runs")
    }
}

fn certs(folder: &Path) {
    let folder = folder.display().to_string();
    let made = dreamstream(&["certs", "--out", &folder, "--policy", "mine"]).output().expect("the binary runs");
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
}

fn wait_for_port(port: u16) {
    wait_for("a port", 60, || std::net::TcpStream::connect(("127.0.0.1", port)).ok());
}

fn log(fleet: &Secured, name: &str) -> String {
    std::fs::read_to_string(fleet.path(name)).unwrap_or_default()
}

#[test]
fn a_fleet_drives_with_certificates_and_lets_no_stranger_in() {
    let mut fleet = Secured::new();
    fleet.start();
    let certs = fleet.path("certs");

    // The second worker finds its device taken, by name.
    wait_for("the refusal of a second worker", 60, || {
        let logs = [log(&fleet, "worker-0.log"), log(&fleet, "worker-1.log")];
        logs.iter().any(|text| text.contains("no_free_device")).then_some(())
    });

    let out = fleet.path("out").display().to_string();
    let driven = fleet.ask(&["submit", SCENARIO, "--duration", "2", "--out", &out], &certs, "certs/token");
    assert!(driven.status.success(), "{}", String::from_utf8_lossy(&driven.stderr));
    let results = std::fs::read_to_string(fleet.path("out/results.json")).expect("results");
    let results: serde_json::Value = serde_json::from_str(&results).expect("results are JSON");
    assert_eq!(results["episodes"][0]["status"], "completed");
    assert_eq!(results["run"]["insecure"], false);

    // A wrong token, no token, and another authority.
    std::fs::write(fleet.path("wrong"), "0123456789abcdef0123456789abcdef").expect("is written");
    let refused = fleet.ask(&["health"], &certs, "wrong");
    assert!(String::from_utf8_lossy(&refused.stderr).contains("token"), "{refused:?}");
    assert!(!refused.status.success());
    self::certs(&fleet.path("foreign"));
    let foreign = fleet.path("foreign");
    assert!(!fleet.ask(&["health"], &foreign, "certs/token").status.success());
    assert!(fleet.ask(&["health"], &certs, "certs/token").status.success());
    fleet.serve("sim-server", &foreign, "stranger.log", &[]);
    let ended = wait_for("the end of a stranger", 60, || fleet.children.last_mut()?.try_wait().ok()?);
    assert!(!ended.success(), "a stranger was let onto the bus: {}", log(&fleet, "stranger.log"));
}

#[test]
fn certificates_are_added_and_never_replaced() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    certs(folder.path());
    let read = |name: &str| std::fs::read(folder.path().join(name)).expect("a file");
    let before = ["ca.pem", "ca.key", "router.pem", "token", "mine.json5"].map(read);
    std::fs::remove_file(folder.path().join("vdm-worker.pem")).expect("is there");
    certs(folder.path());
    assert_eq!(before, ["ca.pem", "ca.key", "router.pem", "token", "mine.json5"].map(read));
    assert!(folder.path().join("vdm-worker.pem").exists());
    std::fs::remove_file(folder.path().join("ca.key")).expect("is there");
    let arguments = ["certs", "--out", &folder.path().display().to_string()];
    let half = dreamstream(&arguments).output().expect("the binary runs");
    assert!(String::from_utf8_lossy(&half.stderr).contains("half an authority"), "{half:?}");
}

#[test]
fn in_clear_beyond_loopback_is_refused() {
    for (service, setting) in [
        ("router", "bus.listen=[\"tcp/0.0.0.0:0\"]"),
        ("orchestrator", "control.listen=\"0.0.0.0:0\""),
        ("sim-server", "control.orchestrator=\"http://192.0.2.1:4710\""),
        ("policy-bridge", "policy.listen=\"tcp/0.0.0.0:0\""),
        ("layout-render", "metrics.listen=\"0.0.0.0:0\""),
    ] {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let journal = format!("journal.folder={:?}", folder.path().display().to_string());
        let mut arguments =
            vec!["serve", service, "--set", "bus.mode=\"peer\"", "--set", "bus.connect=[]", "--set", setting];
        if service == "orchestrator" {
            arguments.extend(["--set", &journal]);
        }
        let refused = dreamstream(&arguments).output().expect("the binary runs");
        let text = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(!refused.status.success() && text.contains("beyond loopback"), "{service}: {text}");
    }
}

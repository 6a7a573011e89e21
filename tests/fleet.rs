//! A fleet of child processes on loopback for the system tests: router, orchestrator, the stages, each with its metrics.

use std::path::PathBuf;
use std::process::Child;
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::harness::{dreamstream, free_port, wait_for};

/// One fleet at a time: each is six processes or more.
static ALONE: Mutex<()> = Mutex::new(());

/// A fleet of child processes; killed when dropped.
pub(crate) struct Fleet {
    pub folder: tempfile::TempDir,
    pub bus: u16,
    pub control: u16,
    /// In order of start: router, orchestrator, sim-server, layout-render, policy-bridge, workers.
    pub children: Vec<Child>,
    /// Where each answers Prometheus; the router nowhere.
    pub metrics: Vec<u16>,
    _alone: MutexGuard<'static, ()>,
}

/// The first worker among a fleet's children.
pub(crate) const WORKER: usize = 5;

impl Drop for Fleet {
    fn drop(&mut self) {
        for child in &mut self.children {
            let _gone = child.kill();
            let _waited = child.wait();
        }
    }
}

impl Fleet {
    /// Starts a fleet of so many video workers.
    pub(crate) fn start(workers: usize) -> Self {
        let alone = ALONE.lock().unwrap_or_else(PoisonError::into_inner);
        let folder = tempfile::tempdir().expect("a temporary folder");
        let (bus, control) = (free_port(), free_port());
        let (children, metrics) = (Vec::new(), Vec::new());
        let mut fleet = Self { folder, bus, control, children, metrics, _alone: alone };
        let router = fleet.endpoint();
        let listen = format!("bus.listen=[\"{router}\"]");
        fleet.serve("router", &["bus.mode=\"router\"", "bus.connect=[]", &listen]);
        wait_for_port(bus);
        let connect = format!("bus.connect=[\"{router}\"]");
        let journal = format!("journal.folder={:?}", fleet.path("runs").display().to_string());
        fleet.serve("orchestrator", &[&connect, &journal, &format!("control.listen=\"127.0.0.1:{control}\"")]);
        wait_for_port(control);
        let orchestrator = format!("control.orchestrator={:?}", fleet.orchestrator());
        for service in ["sim-server", "layout-render", "policy-bridge"] {
            fleet.serve(service, &[&connect, &orchestrator]);
        }
        (0..workers).for_each(|_| fleet.serve("vdm-worker", &[&connect, &orchestrator]));
        fleet
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn endpoint(&self) -> String {
        format!("tcp/127.0.0.1:{}", self.bus)
    }

    pub(crate) fn orchestrator(&self) -> String {
        format!("http://127.0.0.1:{}", self.control)
    }

    fn serve(&mut self, service: &str, settings: &[&str]) {
        let (port, mut arguments) = (free_port(), vec!["serve", service]);
        let metrics = format!("127.0.0.1:{port}");
        settings.iter().for_each(|setting| arguments.extend(["--set", setting]));
        if service != "router" {
            arguments.extend(["--metrics", &metrics]);
        }
        self.metrics.push(port);
        self.children.push(self.spawn(&arguments, &format!("{service}-{}.log", self.children.len())));
    }

    /// Starts the binary; what it says goes to a file.
    pub(crate) fn spawn(&self, arguments: &[&str], log: &str) -> Child {
        let log = std::fs::File::create(self.path(log)).expect("a log file");
        let out = log.try_clone().expect("a second handle");
        dreamstream(arguments).stderr(log).stdout(out).spawn().expect("the binary starts")
    }

    pub(crate) fn log(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap_or_default()
    }
}

fn wait_for_port(port: u16) {
    wait_for("a port", 60, || std::net::TcpStream::connect(("127.0.0.1", port)).ok());
}

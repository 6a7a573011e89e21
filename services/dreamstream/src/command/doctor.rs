//! `doctor`: says what this machine has and lacks, and what that means.

use std::path::Path;
use std::process::Command;

use anyhow::Result;
use ds_launch::Networks;
use ds_layout::{LayoutBackend, Renderer};
use ds_policy::Learned;
use ds_process::beside::{TRAINER, VIEWER};
use ds_process::terminal::answer;
use ds_process::{beside, shipped};

struct Finding {
    subject: &'static str,
    well: bool,
    says: String,
}

fn finding(subject: &'static str, result: Result<String, String>) -> Finding {
    match result {
        Ok(says) => Finding { subject, well: true, says },
        Err(says) => Finding { subject, well: false, says },
    }
}

/// Prints one line per finding; what is missing is never fatal for an embedded run, except the weights.
///
/// # Errors
/// If a finding that an embedded run needs is bad.
pub(crate) fn run() -> Result<()> {
    let findings = [
        finding("cpu", cpu()),
        finding("memory", memory()),
        finding("video model", weights("configs/models/cpu_train.safetensors")),
        finding("camera policy", weights("configs/models/camera_policy.safetensors")),
        finding("panel", panel()),
        finding("scenarios", scenarios()),
        finding("layout, cpu", renderer(LayoutBackend::Cpu)),
        finding("layout, wgpu", renderer(LayoutBackend::Wgpu)),
        finding("python3", tool("python3", "--version", "the Python client needs it")),
        finding("docker", tool("docker", "--version", "compose needs it")),
        finding("rerun viewer", viewer()),
        finding("trainer", program(TRAINER)),
    ];
    for Finding { subject, well, says } in &findings {
        answer(&format!("{} {subject:<14} {says}", if *well { "✓" } else { "✗" }));
    }
    let needed = ["video model", "camera policy", "scenarios", "layout, cpu"];
    let missing: Vec<&str> =
        findings.iter().filter(|f| !f.well && needed.contains(&f.subject)).map(|f| f.subject).collect();
    anyhow::ensure!(missing.is_empty(), "an embedded run needs {missing:?}");
    Ok(())
}

fn viewer() -> Result<String, String> {
    program(VIEWER)?;
    tool("rerun", "--version", "`dreamstream view` can still save .rrd files")
}

/// Looks for a program that lies beside this one.
fn program(name: &str) -> Result<String, String> {
    beside::program(name).map(|path| path.display().to_string()).map_err(|error| error.to_string())
}

fn cpu() -> Result<String, String> {
    let cores = std::thread::available_parallelism().map_err(|error| error.to_string())?;
    let wide = if cfg!(target_arch = "x86_64") && cpu_has_avx512() { "AVX-512" } else { "no AVX-512" };
    Ok(format!("{cores} cores, {wide}"))
}

#[cfg(target_arch = "x86_64")]
fn cpu_has_avx512() -> bool {
    std::arch::is_x86_feature_detected!("avx512f")
}

#[cfg(not(target_arch = "x86_64"))]
fn cpu_has_avx512() -> bool {
    false
}

fn memory() -> Result<String, String> {
    let text = std::fs::read_to_string("/proc/meminfo").map_err(|error| error.to_string())?;
    let line = text.lines().find(|line| line.starts_with("MemAvailable")).ok_or("not known")?;
    let kib: u64 = line.split_whitespace().nth(1).and_then(|word| word.parse().ok()).ok_or("not known")?;
    let gib = kib as f64 / (1024.0 * 1024.0);
    if gib < 2.0 { Err(format!("{gib:.1} GiB free, a run needs 2")) } else { Ok(format!("{gib:.1} GiB free")) }
}

fn weights(path: &str) -> Result<String, String> {
    let path = shipped::find(Path::new(path));
    let bytes = std::fs::metadata(&path).map_err(|error| format!("{error}: {}", shipped::describe(&path)))?.len();
    Ok(format!("{:.1} MB in {}", bytes as f64 * 1e-6, path.display()))
}

/// Says which policies of the panel have weights, and how one that has none is trained.
fn panel() -> Result<String, String> {
    let given = Networks::default().policy_weights;
    let panel = Learned::ALL.into_iter().filter(|learned| *learned != Learned::Camera);
    let (trained, rest): (Vec<_>, Vec<_>) =
        panel.partition(|learned| learned.trained(&learned.weights_file(&given)).is_ok());
    let names = |all: &[Learned]| all.iter().map(|learned| learned.name()).collect::<Vec<_>>().join(", ");
    match rest.first() {
        None => Ok(names(&trained)),
        Some(first) => Ok(format!(
            "{}; without weights: {} (`dreamstream train policy --kind {}`)",
            names(&trained),
            names(&rest),
            first.name()
        )),
    }
}

fn scenarios() -> Result<String, String> {
    let found = ds_scenario::list(&shipped::find(Path::new("scenarios/base"))).map_err(|error| error.to_string())?;
    if found.is_empty() { Err("none in scenarios/base".to_owned()) } else { Ok(format!("{} shipped", found.len())) }
}

fn renderer(choice: LayoutBackend) -> Result<String, String> {
    Renderer::new(choice).map(|renderer| renderer.describe().to_owned()).map_err(|error| error.to_string())
}

fn tool(name: &str, argument: &str, without: &str) -> Result<String, String> {
    let output = Command::new(name).arg(argument).output().map_err(|_| format!("not found: {without}"))?;
    let text = String::from_utf8_lossy(&output.stdout);
    Ok(text.lines().next().unwrap_or_default().trim().to_owned())
}

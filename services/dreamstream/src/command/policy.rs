//! `policy doctor`: asks a policy about generated states whose expert plan is known, and says what its wrapping gets wrong.

use std::ffi::OsStr;
use std::path::Path;
use std::process::Stdio;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use ds_camera::{Appearance, ReferenceCamera, SceneCamera};
use ds_launch::{guest, own};
use ds_policy::doctor::{self, Examination, Finding, Fixture, determinism, examine};
use ds_policy::driver::Driver;
use ds_policy::{Builtin, EgoView, Observation, Own, Policy};
use ds_process::service::UsageError;
use ds_process::terminal::{answer, bar};
use ds_raster::RgbImage;
use ds_scenario::{Family, generate};
use ds_sim::{SimConfig, Simulation};
use ds_space::{CameraModel, DVec2, DVec3, Draws, Intrinsics, PoseSe2, Tick};
use policy_bridge::Outsider;
use serde_json::json;
use tokio::process::{Child, Command};
use tokio::runtime::Runtime;

use crate::cli::PolicyCommand;

/// The expert's plan reaches so far, in ticks.
const HORIZON_TICKS: u32 = 40;
/// Scenarios are generated from this seed on.
const FIRST_SEED: u64 = 40_000_000;
/// So many seeds of each family are looked through for a state of each kind.
const SEEDS: u64 = 6;
/// So many calls are timed.
const TIMED_CALLS: usize = 57;
/// The name on the bus of a policy whose process is started here.
const NAME: &str = "examined";
/// Where libraries read how many threads they may have.
const THREADS: [&str; 4] = ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "RAYON_NUM_THREADS"];
/// The state that another camera sees too, as an index of [`KINDS`].
const SEEN_TWICE: usize = 1;
/// What the fixtures show.
const KINDS: [&str; 6] = ["straight", "left", "right", "curve", "stopped at red", "lead braking"];

/// Prints what is wrong.
///
/// # Errors
/// If the policy cannot be made, or anything is wrong with it.
pub(crate) fn run(command: &PolicyCommand) -> Result<()> {
    let PolicyCommand::Doctor { policy: name, json, plans, .. } = command;
    // Until the process ends: a thread may still wait for a policy that does not answer.
    let runtime: &'static Runtime = Box::leak(Box::new(ds_launch::runtime()?));
    let fixtures = fixtures()?;
    let mut patient = Patient::start(command, runtime, &fixtures, None)?;
    if *plans {
        let plans = doctor::plans(&mut *patient.policy, &fixtures).map_err(told)?;
        answer(&json!(plans.iter().map(|plan| numbers(plan)).collect::<Vec<_>>()).to_string());
        return Ok(());
    }
    let bar = bar(u64::from(doctor::ROUNDS) * fixtures.len() as u64, "answers");
    let mut found = examine(&mut *patient.policy, &fixtures, &|| bar.inc(1));
    bar.finish_and_clear();
    let millis = latency(&mut *patient.policy, &fixtures);
    drop(patient);
    if found.findings.is_empty() {
        for threads in [1, 2] {
            let Some(anew) = plans_anew(command, runtime, &fixtures, threads)? else { break };
            let how = format!("in a new process with {threads} thread{}", if threads == 1 { "" } else { "s" });
            let said = determinism(&fixtures, [&found.plans, &anew], &how);
            found.findings.extend(said.findings);
            found.remarks.extend(said.remarks);
        }
    }
    if *json {
        answer(&as_json(name, &fixtures, &found, millis).to_string());
    } else {
        found.findings.iter().for_each(|one| answer(&format!("{:<11} {}", one.check, one.says)));
        found.remarks.iter().for_each(|one| answer(&format!("{:<11} {} (no error)", one.check, one.says)));
        answer(&feature(&found));
        if let Some([first, median, longest]) = millis {
            answer(&format!(
                "latency     first call {first:.1} ms, then median {median:.1} ms, longest {longest:.1} ms"
            ));
        }
        let names: Vec<&str> = fixtures.iter().map(|fixture| fixture.name.as_str()).collect();
        answer(&format!("{} states ({}): {}", fixtures.len(), names.join(", "), counted(&found)));
    }
    if !found.findings.is_empty() {
        bail!("policy {name:?}: {}", counted(&found));
    }
    Ok(())
}

fn as_json(name: &str, fixtures: &[Fixture], found: &Examination, millis: Option<[f64; 3]>) -> serde_json::Value {
    let list =
        |all: &[Finding]| all.iter().map(|one| json!({ "check": one.check, "says": one.says })).collect::<Vec<_>>();
    let names: Vec<_> = fixtures.iter().map(|fixture| fixture.name.as_str()).collect();
    let experts: Vec<_> = fixtures.iter().map(|fixture| numbers(&fixture.expert)).collect();
    json!({
        "policy": name,
        "fixtures": names,
        "findings": list(&found.findings),
        "remarks": list(&found.remarks),
        "latency_ms": millis.map(|[first, median, longest]| json!({ "first": first, "median": median, "longest": longest })),
        "experts": experts,
        "feature": found.feature,
        "plans": found.plans.iter().map(|plan| numbers(plan)).collect::<Vec<_>>(),
    })
}

/// Returns the number of findings in words.
fn counted(found: &Examination) -> String {
    let number = found.findings.len();
    format!("{number} finding{}", if number == 1 { "" } else { "s" })
}

/// Says what the policy tells that it attends to; what is wrong with it is a finding.
fn feature(found: &Examination) -> String {
    let says = match found.feature {
        Some([tokens, channels]) => {
            format!("[{tokens}, {channels}] of each frame, by the frame alone: fit for a panel of FDπ")
        }
        None if found.findings.iter().any(|finding| finding.check == "feature") => "none that is sound".to_owned(),
        None if found.plans.is_empty() => "not asked for: the answers are wrong before".to_owned(),
        None => "none is given: the policy cannot be a member of a panel of FDπ".to_owned(),
    };
    format!("{:<11} {says}", "feature")
}

/// Returns poses as `[x, y, heading]`, in metres and radians.
fn numbers(plan: &[PoseSe2]) -> Vec<[f64; 3]> {
    plan.iter().map(|pose| [pose.position.x, pose.position.y, pose.heading_rad]).collect()
}

fn told(finding: Finding) -> anyhow::Error {
    anyhow::anyhow!("{}: {}", finding.check, finding.says)
}

/// A policy that is examined, with the process that it lives in if it is none of this one's.
struct Patient {
    policy: Box<dyn Policy>,
    _process: Option<Child>,
}

impl Patient {
    /// Makes the policy, or waits until it has connected; a process of its own may have so many threads.
    fn start(command: &PolicyCommand, runtime: &Runtime, fixtures: &[Fixture], threads: Option<u32>) -> Result<Self> {
        let PolicyCommand::Doctor { policy: name, policy_weights: weights, policy_listen, together, python, .. } =
            command;
        if let Some(listen) = policy_listen {
            let outside = guest::open(runtime, name, listen)?;
            return Ok(Self { policy: Box::new(Outsider::new(outside, *together)), _process: None });
        }
        if name.contains(".py:") {
            let process = |endpoint: &str| {
                let mut process = Command::new(python);
                process.args(["-m", "dreamstream", "run", name, "--quiet", "--name", NAME, "--connect", endpoint]);
                for key in THREADS {
                    process.envs(threads.map(|number| (key, number.to_string())));
                }
                process
            };
            return Self::of_process(process, runtime, &fixtures[0]);
        }
        Ok(Self { policy: inside(name, weights)?, _process: None })
    }

    /// Starts a process that connects to an endpoint, and waits until it has answered once.
    fn of_process(process: impl Fn(&str) -> Command, runtime: &Runtime, first: &Fixture) -> Result<Self> {
        let outside = guest::open(runtime, NAME, "tcp/127.0.0.1:0")?;
        let mut process = process(outside.listens().first().context("an endpoint is open")?);
        process.stdin(Stdio::null()).stdout(Stdio::null()).kill_on_drop(true);
        let _in = runtime.enter();
        let mut process = process.spawn().context("start the policy's process")?;
        let policy = Outsider::new(outside, true);
        let (mut asked, seen) = (policy.clone(), first.observation.clone());
        // What is wrong with the answer is found when it is asked again.
        let answered = std::thread::spawn(move || asked.plan(&seen, None).is_ok());
        while !answered.is_finished() {
            if let Some(status) = process.try_wait().context("watch the policy's process")? {
                bail!("the policy's process ended before it answered: {status}");
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        Ok(Self { policy: Box::new(policy), _process: Some(process) })
    }
}

/// Makes a policy that runs in this process.
///
/// # Errors
/// [`UsageError`] if there is none of the name, its files cannot be used or it is privileged.
fn inside(name: &str, weights: &Path) -> Result<Box<dyn Policy>> {
    let refused = |says: String| Err(UsageError(format!("policy {name:?} {says}")).into());
    if let Some(manifest) = Own::named(name) {
        return Ok(Box::new(own::read(&manifest)?));
    }
    match Path::new(name).extension().and_then(OsStr::to_str) {
        Some("onnx") => return refused("is a network, which is named by its manifest, FILE.toml".to_owned()),
        Some("py") => return refused("is a file, a class of it is named FILE.py:CLASS".to_owned()),
        _ => {}
    }
    match ds_policy::builtin(name, &Builtin { weights: Some(weights.to_path_buf()) }) {
        Ok(policy) if policy.privileged() => {
            refused("is privileged: it plans from the scenario, not from what the fixtures show".to_owned())
        }
        Ok(policy) => Ok(policy),
        Err(error) => Err(UsageError(format!("{:#}", anyhow::Error::from(error))).into()),
    }
}

/// Returns the plans of a new process with so many threads; none where the process is not started here.
fn plans_anew(
    command: &PolicyCommand,
    runtime: &Runtime,
    fixtures: &[Fixture],
    threads: u32,
) -> Result<Option<Vec<Vec<PoseSe2>>>> {
    let PolicyCommand::Doctor { policy: name, policy_weights, policy_listen, .. } = command;
    if policy_listen.is_some() {
        return Ok(None);
    }
    if name.contains(".py:") {
        let mut patient = Patient::start(command, runtime, fixtures, Some(threads))?;
        return doctor::plans(&mut *patient.policy, fixtures).map(Some).map_err(told);
    }
    let mut process = std::process::Command::new(std::env::current_exe().context("path of this binary")?);
    process.args(["policy", "doctor", name, "--plans", "--policy-weights"]).arg(policy_weights);
    process.envs(THREADS.map(|key| (key, threads.to_string()))).stderr(Stdio::inherit());
    let output = process.output().context("start this binary anew")?;
    ensure!(output.status.success(), "this policy in a new process ended with {}", output.status);
    let numbers: Vec<Vec<[f64; 3]>> = serde_json::from_slice(&output.stdout).context("plans of a new process")?;
    let pose = |[x, y, heading_rad]: [f64; 3]| PoseSe2 { position: DVec2::new(x, y), heading_rad };
    Ok(Some(numbers.into_iter().map(|plan| plan.into_iter().map(pose).collect()).collect()))
}

/// Returns the time of the first call, and the median and longest of those after it, in milliseconds; none for a policy that
/// does not answer.
fn latency(policy: &mut dyn Policy, fixtures: &[Fixture]) -> Option<[f64; 3]> {
    let mut millis = Vec::new();
    for fixture in fixtures.iter().cycle().take(TIMED_CALLS) {
        let began = Instant::now();
        policy.plan(&fixture.observation, None).ok()?;
        millis.push(began.elapsed().as_secs_f64() * 1e3);
    }
    let first = *millis.first()?;
    let rest = &mut millis[1..];
    rest.sort_by(f64::total_cmp);
    Some([first, rest[rest.len() / 2], *rest.last()?])
}

/// Makes one state of each kind from generated scenarios, with the expert's plan, one of them as another camera sees it, and
/// the first one in black.
fn fixtures() -> Result<Vec<Fixture>> {
    let mut found: Vec<Option<Fixture>> = vec![None; KINDS.len()];
    let mut other = None;
    'search: for seed in FIRST_SEED..FIRST_SEED + SEEDS {
        for family in Family::ALL {
            let scene = Arc::new(generate(family, seed));
            let driver = Driver::new(&scene);
            for tick in (0..100).step_by(20).map(Tick) {
                let simulation = Simulation::new(Arc::clone(&scene), SimConfig::default(), tick)?;
                let expert = plan(&driver, &simulation);
                let speed_mps = simulation.state().ego.speed_mps();
                let Some(kind) = kind_of(family, speed_mps, &expert) else { continue };
                if found[kind].is_some() {
                    continue;
                }
                let camera = scene.cameras.first().context("a generated scenario has a camera")?;
                if kind == SEEN_TWICE {
                    let seen = fixture("other camera", &simulation, &scene, &other_than(camera), &expert)?;
                    other = Some(Fixture { twin: Some(SEEN_TWICE), ..seen });
                }
                found[kind] = Some(fixture(KINDS[kind], &simulation, &scene, camera, &expert)?);
                if found.iter().all(Option::is_some) {
                    break 'search;
                }
            }
        }
    }
    let missing = KINDS.iter().zip(&found).find(|(_, found)| found.is_none());
    if let Some((kind, _)) = missing {
        bail!("no generated scenario shows {kind:?} within {SEEDS} seeds of each family from {FIRST_SEED}");
    }
    let mut fixtures: Vec<Fixture> = found.into_iter().flatten().chain(other).collect();
    let mut black = fixtures.first().cloned().context("there is a straight fixture")?;
    black.name = "black".to_owned();
    for image in black.observation.frames.iter_mut().flatten() {
        *image = RgbImage::filled(image.width_px(), image.height_px(), [0; 3]);
    }
    fixtures.push(black);
    Ok(fixtures)
}

/// Returns the expert's poses of the next ticks, in the rig of now.
fn plan(driver: &Driver, simulation: &Simulation) -> Vec<PoseSe2> {
    let world = simulation.state();
    let driven = driver.drive(&world.ego, world.tick, HORIZON_TICKS);
    driven.iter().map(|pose| world.ego.pose.relative(pose)).collect()
}

/// Returns what the expert does in a state as an index of [`KINDS`], if it is one of them.
fn kind_of(family: Family, speed_mps: f64, expert: &[PoseSe2]) -> Option<usize> {
    let end = expert.last()?;
    let way_m = end.position.length();
    let steady_m = speed_mps * 0.1 * f64::from(HORIZON_TICKS);
    match end.heading_rad {
        _ if family == Family::SignalisedCrossing && way_m < 0.5 => Some(4),
        _ if family == Family::LeadBraking && speed_mps > 5.0 && way_m < 0.75 * steady_m => Some(5),
        turn if turn > 0.8 => Some(1),
        turn if turn < -0.8 => Some(2),
        turn if turn.abs() > 0.15 && turn.abs() < 0.6 => Some(3),
        turn if turn.abs() < 0.02 && speed_mps > 5.0 => Some(0),
        _ => None,
    }
}

/// Returns a camera of the same name and size with another lens, lower, farther back and less inclined.
fn other_than(camera: &CameraModel) -> CameraModel {
    let lens = &camera.intrinsics;
    let wide = Intrinsics::centred(lens.width_px, lens.height_px, 95f64.to_radians());
    CameraModel::mounted(camera.id.clone(), wide, DVec3::new(0.9, 0.0, 1.3), 0.0, 0.0)
}

fn fixture(
    name: &str,
    simulation: &Simulation,
    scene: &Arc<ds_world::Scene>,
    camera: &CameraModel,
    expert: &[PoseSe2],
) -> Result<Fixture> {
    let world = simulation.state();
    let drawn = ReferenceCamera::new(scene, Appearance::from_seed(0));
    let frame = drawn.on_ego(world, camera)?;
    let observation = Observation {
        frames: vec![vec![frame]],
        cameras: vec![camera.clone()],
        ego: EgoView::of(std::slice::from_ref(&world.ego)),
        command: simulation.route_command(),
        stamps: vec![world.time],
        horizon_ticks: HORIZON_TICKS,
        dt: scene.dt,
        draw: Draws::from_seed(0, "policy doctor"),
    };
    Ok(Fixture { name: name.to_owned(), observation, expert: expert.to_vec(), twin: None })
}

//! `policy doctor`: asks a policy about generated states whose expert plan is known, and says what its wrapping gets wrong.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use ds_camera::{Appearance, ReferenceCamera};
use ds_policy::doctor::{Finding, Fixture, examine, remarks};
use ds_policy::driver::Driver;
use ds_policy::{Builtin, EgoView, Observation, Own, Policy};
use ds_raster::RgbImage;
use ds_scenario::{Family, generate};
use ds_sim::{SimConfig, Simulation};
use ds_space::{Draws, PoseSe2, Tick};
use serde_json::json;

use crate::cli::PolicyCommand;
use crate::command::answer;
use crate::own;

/// The expert's plan reaches so far, in ticks.
const HORIZON_TICKS: u32 = 40;
/// Scenarios are generated from this seed on.
const FIRST_SEED: u64 = 40_000_000;
/// So many seeds of each family are looked through for a state of each kind.
const SEEDS: u64 = 6;
/// So many calls are timed.
const TIMED_CALLS: usize = 57;
/// What the fixtures show.
const KINDS: [&str; 6] = ["straight", "left", "right", "curve", "stopped at red", "lead braking"];

/// Prints what is wrong.
///
/// # Errors
/// If the policy cannot be made, or anything is wrong with it.
pub(crate) fn run(command: &PolicyCommand) -> Result<()> {
    let PolicyCommand::Doctor { policy: name, policy_weights: weights, json } = command;
    let mut policy = match Own::named(name) {
        Some(manifest) => Box::new(own::read(&manifest)?) as Box<dyn Policy>,
        None => ds_policy::builtin(name, &Builtin { weights: Some(weights.clone()) })?,
    };
    if policy.privileged() {
        bail!("policy {name:?} is privileged: it plans from the scenario, not from what the fixtures show");
    }
    let fixtures = fixtures()?;
    let findings = examine(&mut *policy, &fixtures);
    let remarks = remarks(&mut *policy, &fixtures);
    let millis = latency(&mut *policy, &fixtures);
    if *json {
        let list =
            |all: &[Finding]| all.iter().map(|one| json!({ "check": one.check, "says": one.says })).collect::<Vec<_>>();
        let names: Vec<_> = fixtures.iter().map(|fixture| fixture.name.as_str()).collect();
        let told = json!({
            "policy": name,
            "fixtures": names,
            "findings": list(&findings),
            "remarks": list(&remarks),
            "latency_ms": millis.map(|[first, median, longest]| json!({ "first": first, "median": median, "longest": longest })),
        });
        answer(&told.to_string());
    } else {
        findings.iter().for_each(|one| answer(&format!("{:<9} {}", one.check, one.says)));
        remarks.iter().for_each(|one| answer(&format!("{:<9} {} (no error)", one.check, one.says)));
        if let Some([first, median, longest]) = millis {
            answer(&format!("latency   first call {first:.1} ms, then median {median:.1} ms, longest {longest:.1} ms"));
        }
        let names: Vec<&str> = fixtures.iter().map(|fixture| fixture.name.as_str()).collect();
        answer(&format!("{} states ({}): {} findings", fixtures.len(), names.join(", "), findings.len()));
    }
    if !findings.is_empty() {
        bail!("policy {name:?}: {} findings", findings.len());
    }
    Ok(())
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

/// Makes one state of each kind from generated scenarios, with the expert's plan, and the first one in black.
fn fixtures() -> Result<Vec<Fixture>> {
    let mut found: Vec<Option<Fixture>> = vec![None; KINDS.len()];
    'search: for seed in FIRST_SEED..FIRST_SEED + SEEDS {
        for family in Family::ALL {
            let scene = Arc::new(generate(family, seed));
            let driver = Driver::new(&scene);
            for tick in (0..100).step_by(20).map(Tick) {
                let simulation = Simulation::new(Arc::clone(&scene), SimConfig::default(), tick)?;
                let expert = plan(&driver, &simulation);
                let speed_mps = simulation.state().ego.speed_mps();
                let Some(kind) = kind_of(family, speed_mps, &expert) else { continue };
                if found[kind].is_none() {
                    found[kind] = Some(fixture(KINDS[kind], &simulation, &scene, expert)?);
                }
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
    let mut fixtures: Vec<Fixture> = found.into_iter().flatten().collect();
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

fn fixture(name: &str, simulation: &Simulation, scene: &Arc<ds_world::Scene>, expert: Vec<PoseSe2>) -> Result<Fixture> {
    let world = simulation.state();
    let camera = scene.cameras.first().context("a generated scenario has a camera")?;
    let drawn = ReferenceCamera::new(scene, Appearance::from_seed(0));
    let frame = drawn.render(world, camera, world.ego.pose.world_from_rig(0.0))?;
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
    Ok(Fixture { name: name.to_owned(), observation, expert })
}

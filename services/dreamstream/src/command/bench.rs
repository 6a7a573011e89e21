//! `bench`: simulation step, oracle, layout frame, reference frame, video frame and bus hop on this machine, median of several rounds.

use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use ds_bus::BusSession;
use ds_camera::{Appearance, ReferenceCamera, SceneCamera};
use ds_launch::scenarios;
use ds_layout::{LayoutBackend, LayoutScene, Renderer, StaticMap};
use ds_oracle::{AgentsIn, Oracle};
use ds_policy::lattice::Lattice;
use ds_policy::{EgoView, Observation, Policy};
use ds_process::terminal::answer;
use ds_sim::{IdmScope, SimConfig, Simulation};
use ds_space::{AttemptId, Digest, Draws, EpisodeId, InstanceId, PoseSe2, SimTime, Tick};
use ds_topic::{Envelope, Header, SCHEMA_VERSION, Slot, Topic};
use ds_video::{Rollout, VideoModel};
use ds_world::{Proposal, Scene, Trajectory, TrajectoryPoint};
use std::sync::Arc;

use crate::cli::BenchArgs;

const ROUNDS: usize = 7;

/// Measures and prints one line per figure.
///
/// # Errors
/// If a scenario or the model cannot be loaded.
pub(crate) fn run(args: &BenchArgs) -> Result<()> {
    let first = scenarios::files(&args.scenarios)?.into_iter().next().context("no scenario")?;
    answer(&format!("{:<28} {:<22} {:>12} {:>14} {:>9}", "what", "scenario", "median ms", "per second", "budget"));
    video(args, &ds_scenario::load(&first)?.0)?;
    for file in scenarios::files(&args.scenarios)? {
        let scene = Arc::new(ds_scenario::load(&file)?.0);
        step(&scene)?;
        oracle(&scene)?;
        layout(&scene)?;
        reference(&scene)?;
    }
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    runtime.block_on(hop())
}

fn report(what: &str, scenario: &str, rounds: &[Duration], count: u32, budget: &str) {
    let mut secs: Vec<f64> = rounds.iter().map(Duration::as_secs_f64).collect();
    let Some(median) = ds_stats::upper_median(&mut secs) else { return };
    let median = median / f64::from(count.max(1));
    answer(&format!("{what:<28} {scenario:<22} {:>12.4} {:>14.1} {budget:>9}", median * 1e3, 1.0 / median.max(1e-12)));
}

fn step(scene: &Arc<Scene>) -> Result<()> {
    let config = SimConfig { agents: Some(IdmScope::All), ..SimConfig::default() };
    let ticks = scene.last_tick().0;
    let mut rounds = Vec::new();
    for _ in 0..ROUNDS {
        let mut simulation = Simulation::new(Arc::clone(scene), config.clone(), Tick(0))?;
        let began = Instant::now();
        for tick in 0..ticks {
            if tick.is_multiple_of(5) {
                simulation.begin_plan(&straight_on(simulation.state().ego.speed_mps())?);
            }
            simulation.step();
        }
        rounds.push(began.elapsed());
    }
    report("sim step, all agents IDM", &scene.name, &rounds, ticks, "0.2 ms");
    Ok(())
}

/// Ranks the 64 proposals of the lattice policy 3 s into the drive, with reacting agents.
fn oracle(scene: &Arc<Scene>) -> Result<()> {
    let mut simulation = Simulation::new(Arc::clone(scene), SimConfig::default(), Tick(0))?;
    for _ in 0..30 {
        simulation.step();
    }
    let ego = EgoView::of(std::slice::from_ref(&simulation.state().ego));
    let observation = Observation {
        frames: Vec::new(),
        cameras: Vec::new(),
        ego,
        command: simulation.route_command(),
        stamps: vec![simulation.state().time],
        horizon_ticks: 80,
        dt: scene.dt,
        draw: Draws::from_seed(0, "bench"),
    };
    let planned = Lattice.plan(&observation, None)?;
    let proposals: Vec<Proposal> =
        planned.proposals.into_iter().map(|one| Proposal { trajectory: one.trajectory, score: one.score }).collect();
    let oracle = Oracle::new(scene)?;
    let mut rounds = Vec::new();
    for _ in 0..ROUNDS {
        let began = Instant::now();
        oracle.rank(&simulation, &proposals, AgentsIn::Reacting)?;
        rounds.push(began.elapsed());
    }
    report("oracle, 64 proposals", &scene.name, &rounds, 1, "150 ms");
    Ok(())
}

/// Plans 4 s straight ahead at a speed.
fn straight_on(speed_mps: f64) -> Result<Trajectory> {
    let at = |index: i64| TrajectoryPoint {
        after: SimTime(index * 500_000_000),
        pose: PoseSe2::new(speed_mps * 0.5 * index as f64, 0.0, 0.0),
    };
    Ok(Trajectory::new((1..=8).map(at).collect())?)
}

fn layout(scene: &Scene) -> Result<()> {
    let map = StaticMap::new(&scene.map);
    let mut renderer = Renderer::new(LayoutBackend::Cpu)?;
    let Some(camera) = scene.cameras.first() else { return Ok(()) };
    let mut rounds = Vec::new();
    for _ in 0..ROUNDS {
        let began = Instant::now();
        for tick in Tick(0).to(Tick(19)) {
            let world = scene.logged_world(tick);
            let described = LayoutScene { map: &map, world: &world };
            renderer.render(&described, camera, world.ego.pose.world_from_rig(0.0))?;
        }
        rounds.push(began.elapsed());
    }
    report("layout frame, cpu", &scene.name, &rounds, 20, "3 ms");
    Ok(())
}

fn reference(scene: &Scene) -> Result<()> {
    let renderer = ReferenceCamera::new(scene, Appearance::DAY);
    let Some(camera) = scene.cameras.first() else { return Ok(()) };
    let mut rounds = Vec::new();
    for _ in 0..ROUNDS {
        let began = Instant::now();
        for tick in Tick(0).to(Tick(4)) {
            let world = scene.logged_world(tick);
            std::hint::black_box(renderer.on_ego(&world, camera)?);
        }
        rounds.push(began.elapsed());
    }
    report("reference frame", &scene.name, &rounds, 5, "15 ms");
    Ok(())
}

fn video(args: &BenchArgs, scene: &Scene) -> Result<()> {
    let config = vdm_worker::load_config(&args.model).map_err(anyhow::Error::msg)?;
    let weights = config.weights_beside(&args.model);
    let model = VideoModel::load(&config, &weights).with_context(|| format!("weights {}", weights.display()))?;
    let model = Arc::new(model);
    let Some(camera) = scene.cameras.first() else { return Ok(()) };
    let map = StaticMap::new(&scene.map);
    let mut renderer = Renderer::new(LayoutBackend::Cpu)?;
    let mut layouts = Vec::new();
    for tick in Tick(0).to(Tick(60)) {
        let world = scene.logged_world(tick);
        let described = LayoutScene { map: &map, world: &world };
        layouts.push(renderer.render(&described, camera, world.ego.pose.world_from_rig(0.0))?);
    }
    let world = scene.logged_world(Tick(0));
    let first = ReferenceCamera::new(scene, Appearance::DAY).on_ego(&world, camera)?;
    let key = ds_space::Draws::key(&scene.digest, "day", 0);
    let (mut rollout, _) = Rollout::new(model, key, camera.id.as_str(), &scene.prompt, &first, &layouts[0])?;
    let mut rounds = Vec::new();
    for chunk in layouts[1..].chunks(5) {
        let began = Instant::now();
        rollout.generate(chunk)?;
        rounds.push(began.elapsed());
    }
    report("video frame, 5 per replan", &scene.name, &rounds, 5, "200 ms");
    Ok(())
}

async fn hop() -> Result<()> {
    for (what, bytes) in [("bus hop, 100 B", 100usize), ("bus hop, one frame", 46_080)] {
        let bus = BusSession::embedded().await?;
        let rounds = hops(&bus, bytes).await?;
        report(what, "embedded", &rounds, 1, "1 ms");
    }
    Ok(())
}

/// Times pushes of a body to a subscriber of the same session.
async fn hops(bus: &BusSession, bytes: usize) -> Result<Vec<Duration>> {
    let episode = EpisodeId::new("bench")?;
    let mut received = bus.subscribe(&episode, &[Topic::Frame]).await?;
    let mut rounds = Vec::new();
    for index in 0..50 {
        let slot = Slot::of_camera(Topic::Frame, index, 0);
        let header = Header {
            episode: episode.clone(),
            attempt: AttemptId(1),
            term: 1,
            epoch: 1,
            iteration: index,
            tick: Tick(index),
            time: SimTime(0),
            sequence: u64::from(index),
            publisher: InstanceId::new("bench")?,
            schema_version: SCHEMA_VERSION,
            trace: String::new(),
            slot,
            content: Digest::default(),
        };
        let envelope = Envelope { header, body: vec![0; bytes].into() };
        let began = Instant::now();
        bus.publish(&envelope).await?;
        received.recv().await;
        rounds.push(began.elapsed());
    }
    Ok(rounds)
}

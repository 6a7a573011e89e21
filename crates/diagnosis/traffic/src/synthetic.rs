//! Labelled cases from the own simulator: scenes, drives among agents with a withheld effect, what the car saw of them.
//!
//! Scenes are busy roads drawn here (three lanes, a crossing street, a light, people on and off a crosswalk) and families
//! of `ds_scenario`. The ego keeps to its log at another pace, so that agents must react. Detections have the noise of a
//! vehicle log: 0.15 m, 0.02 rad, 0.2 m/s.

use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

use ds_diagnosis::CaseError;
use ds_diagnosis::meta::{RecordingEntry, TrafficMeta};
use ds_effect::Setting;
use ds_scenario::{Family, ScenarioError, generate, save};
use ds_sim::{IdmScope, Manners, SimConfig, SimError, Simulation};
use ds_space::{DVec2, DVec3, Digest, Draws, PoseSe2, SimTime, Tick};
use ds_world::{
    AgentClass, Crosswalk, EgoState, Lane, LaneId, LaneKind, LightState, Map, Origin, Scene, Size, StopLine, Track,
    TrackPoint, TrafficLight, Trajectory, TrajectoryPoint, VehicleParameters,
};

const TICKS: u32 = 201;
const REACH_M: f64 = 80.0;
const NOISE: [f64; 3] = [0.15, 0.02, 0.2];
const WARM_UP: u32 = 5;

/// Why a case cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum SyntheticError {
    /// A scene cannot be saved.
    #[error("cannot save a scene")]
    Save(#[from] ScenarioError),
    /// A scene cannot be driven.
    #[error("cannot drive a scene")]
    Drive(#[from] SimError),
    /// The description cannot be written.
    #[error(transparent)]
    Describe(#[from] CaseError),
    /// A file cannot be written.
    #[error("cannot write the case")]
    Write(#[from] std::io::Error),
}

/// Writes a case of eight recordings with effects; the draw depends on the seed alone.
///
/// # Errors
/// If a file cannot be written or a scene not driven.
pub fn write_case(folder: &Path, seed: u64, effects: &[Setting]) -> Result<(), SyntheticError> {
    std::fs::create_dir_all(folder)?;
    let mut recordings = Vec::new();
    for (number, mut scene) in scenes(seed).into_iter().enumerate() {
        scene.name = format!("{number}-{}", scene.name);
        let file = format!("{number}.scenario.json");
        save(&scene, &folder.join(&file))?;
        // As every reader gets it: saved numbers are rounded.
        let (scene, _) = ds_scenario::load(&folder.join(&file))?;
        let tracks = format!("{number}.csv");
        std::fs::write(folder.join(&tracks), drive(Arc::new(scene), seed, effects)?)?;
        recordings.push(RecordingEntry { scene: file.into(), tracks: Some(tracks.into()), from_secs: 0.5 });
    }
    Ok(TrafficMeta { recordings, ..TrafficMeta::default() }.write(folder)?)
}

/// Returns eight scenes; the fourth and the last are kept from fits.
#[must_use]
pub fn scenes(seed: u64) -> Vec<Scene> {
    vec![
        busy(seed, 0),
        generate(Family::PedestrianCrossing, seed),
        generate(Family::SignalisedCrossing, seed),
        busy(seed, 1),
        busy(seed, 2),
        generate(Family::UnprotectedLeft, seed),
        busy(seed, 3),
        busy(seed, 4),
    ]
}

/// Draws in order.
struct Dice {
    draws: Draws,
    next: u64,
}

impl Dice {
    fn range(&mut self, low: f64, high: f64) -> f64 {
        self.next += 1;
        self.draws.range(self.next, low, high)
    }
}

fn busy(seed: u64, number: u64) -> Scene {
    let mut dice = Dice { draws: Draws::from_seed(seed * 16 + number, "busy road"), next: 0 };
    let crossing_m = dice.range(50.0, 90.0);
    let walk_m = crossing_m + dice.range(35.0, 55.0);
    let light_m = walk_m + dice.range(50.0, 70.0);
    let ego_mps = dice.range(6.0, 8.0);
    let mut tracks = Vec::new();
    for lane in 0..3 {
        let mut at_m = -100.0 + dice.range(0.0, 15.0);
        while at_m < 60.0 {
            let speed_mps = dice.range(5.0, 13.0);
            if lane != 1 || (at_m + 20.0).abs() > 14.0 {
                tracks.push(along([at_m, 3.5 * f64::from(lane)], 0.0, CAR, AgentClass::Vehicle, speed_mps));
            }
            at_m += dice.range(18.0, 42.0);
        }
    }
    let north = std::f64::consts::FRAC_PI_2;
    let mut at_m = -25.0;
    for _ in 0..5 {
        at_m -= dice.range(14.0, 45.0);
        let speed_mps = dice.range(6.0, 10.0);
        tracks.push(along([crossing_m, at_m], north, CAR, AgentClass::Vehicle, speed_mps));
    }
    for place_m in [walk_m, walk_m, walk_m, walk_m + 25.0, walk_m + 32.0, crossing_m - 30.0] {
        let speed_mps = dice.range(1.0, 1.7);
        let from_m = -4.0 - speed_mps * dice.range(1.0, 13.0);
        let person = Size { length_m: 0.6, width_m: 0.6, height_m: 1.8 };
        let aside_m = dice.range(-1.0, 1.0);
        tracks.push(along([place_m + aside_m, from_m], north, person, AgentClass::Pedestrian, speed_mps));
    }
    for (number, track) in tracks.iter_mut().enumerate() {
        track.name = format!("{} {number}", format!("{:?}", track.class).to_lowercase());
    }
    let green_from = dice.range(80.0, 150.0) as usize;
    Scene {
        adversary: None,
        name: format!("busy-{seed}-{number}"),
        family: String::new(),
        digest: Digest::default(),
        dt: SimTime::from_secs(0.1),
        map: map([crossing_m, walk_m, light_m], green_from),
        vehicle: VehicleParameters::ZOE,
        ego_log: (0..TICKS).map(|tick| ego(-20.0 + ego_mps * 0.1 * f64::from(tick), ego_mps)).collect(),
        route: vec![DVec2::new(-60.0, 3.5), DVec2::new(400.0, 3.5)],
        tracks,
        cameras: generate(Family::FreeCurve, 1).cameras.into_iter().take(1).collect(),
        prompt: String::new(),
        origin: Origin { source: format!("busy road, seed {seed}"), ..Origin::default() },
    }
}

const CAR: Size = Size { length_m: 4.5, width_m: 1.9, height_m: 1.6 };

fn ego(x_m: f64, speed_mps: f64) -> EgoState {
    EgoState { pose: PoseSe2::new(x_m, 3.5, 0.0), velocity_mps: DVec2::new(speed_mps, 0.0), ..EgoState::default() }
}

fn along(from: [f64; 2], heading_rad: f64, size: Size, class: AgentClass, speed_mps: f64) -> Track {
    let direction = DVec2::from_angle(heading_rad);
    let point = |tick: u32| {
        let position = DVec2::from(from) + direction * (speed_mps * 0.1 * f64::from(tick));
        let pose = PoseSe2 { position, heading_rad };
        Some(TrackPoint { pose, z_m: 0.0, velocity_mps: direction * speed_mps })
    };
    Track { name: String::new(), class, size, points: (0..TICKS).map(point).collect() }
}

fn map([crossing_m, walk_m, light_m]: [f64; 3], green_from: usize) -> Map {
    let lane = |name: &str, from: DVec2, to: DVec2| Lane {
        name: name.to_owned(),
        kind: LaneKind::Road,
        centre_line: vec![from, to],
        polygon: Vec::new(),
        speed_limit_mps: None,
        successors: Vec::new(),
        predecessors: Vec::new(),
        left: None,
        right: None,
    };
    let mut lanes: Vec<Lane> = [0.0, 3.5, 7.0]
        .iter()
        .map(|y| lane(&format!("east {y}"), DVec2::new(-250.0, *y), DVec2::new(600.0, *y)))
        .collect();
    for (k, lane) in lanes.iter_mut().enumerate() {
        let at = |k: usize| u32::try_from(k).ok().map(LaneId);
        lane.left = at(k + 1).filter(|_| k < 2);
        lane.right = k.checked_sub(1).and_then(at);
    }
    lanes.push(lane("north", DVec2::new(crossing_m, -300.0), DVec2::new(crossing_m, 300.0)));
    let corners = [[-2.0, -4.0], [2.0, -4.0], [2.0, 11.0], [-2.0, 11.0]];
    let polygon = corners.map(|[x, y]| DVec2::new(walk_m + x, y)).to_vec();
    let states = (0..TICKS as usize).map(|tick| if tick < green_from { LightState::Red } else { LightState::Green });
    Map {
        lanes,
        crosswalks: vec![Crosswalk { polygon }],
        stop_lines: vec![StopLine { points: [DVec2::new(light_m, -3.0), DVec2::new(light_m, 10.0)], light: Some(0) }],
        traffic_lights: vec![TrafficLight {
            position: DVec3::new(light_m + 10.0, 0.0, 5.0),
            facing_rad: std::f64::consts::PI,
            lanes: vec![LaneId(0), LaneId(1), LaneId(2)],
            states: states.collect(),
        }],
        ..Map::default()
    }
}

/// Drives a scene and returns what the car saw as a table.
fn drive(scene: Arc<Scene>, seed: u64, effects: &[Setting]) -> Result<String, SyntheticError> {
    let config = SimConfig {
        agents: Some(IdmScope::All),
        manners: Manners::ALL,
        effects: effects.to_vec(),
        ..SimConfig::default()
    };
    let key = Draws::key(&scene.digest, "day", seed);
    let pace = Draws::new(&key, "pace", &[]).range(0, 0.7, 1.1);
    let last = scene.last_tick().0;
    let mut simulation = Simulation::new(Arc::clone(&scene), config, Tick(0))?;
    let mut text = String::from("t,id,x,y,yaw,v\n");
    for tick in 0..=last {
        let state = simulation.state();
        let ego = state.ego.centre(&scene.vehicle);
        let secs = state.time.secs();
        let row = |id: i64, pose: &PoseSe2, speed_mps: f64| {
            let purpose = [u64::from(tick), u64::try_from(id + 1).unwrap_or(0)];
            let draws = Draws::new(&key, "detection", &purpose);
            let sd = if id < 0 { [0.02, 0.002, 0.03] } else { NOISE };
            let noise = |index: u64, sd: f64| sd * draws.normal(index);
            format!(
                "{secs:.1},{id},{:.3},{:.3},{:.4},{:.3}\n",
                pose.position.x + noise(0, sd[0]),
                pose.position.y + noise(1, sd[0]),
                pose.heading_rad + noise(2, sd[1]),
                speed_mps + noise(3, sd[2])
            )
        };
        write!(text, "{}", row(-1, &ego, state.ego.speed_mps())).map_err(std::io::Error::other)?;
        for agent in state.agents.iter().filter(|agent| agent.pose.position.distance(ego.position) < REACH_M) {
            let speed_mps = agent.velocity_mps.dot(agent.pose.forward());
            write!(text, "{}", row(i64::from(agent.id.0), &agent.pose, speed_mps)).map_err(std::io::Error::other)?;
        }
        if tick >= WARM_UP && tick % 5 == 0 {
            let plan = plan(&scene, &simulation.state().ego.pose, tick, pace);
            if let Some(plan) = plan {
                simulation.begin_plan(&plan);
            }
        }
        simulation.step();
    }
    Ok(text)
}

/// Returns the logged way from where the ego is, at another pace, as a plan of 4 s.
fn plan(scene: &Scene, from: &PoseSe2, tick: u32, pace: f64) -> Option<Trajectory> {
    let point = |k: u32| {
        let ahead = pace * f64::from(tick + 5 * k - WARM_UP) + f64::from(WARM_UP);
        let logged = |tick: f64| scene.logged_ego(Tick(tick as u32)).pose;
        let (a, b) = (logged(ahead.floor()), logged(ahead.ceil()));
        let position = a.position.lerp(b.position, ahead.fract());
        let there = PoseSe2 { position, heading_rad: a.heading_rad };
        TrajectoryPoint { after: SimTime::from_secs(0.5 * f64::from(k)), pose: from.relative(&there) }
    };
    Trajectory::new((1..=8).map(point).collect()).ok()
}

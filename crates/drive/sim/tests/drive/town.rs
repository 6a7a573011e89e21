//! A town in which agents decide: two lanes eastwards, a street that crosses, a light, people on and off a crosswalk.
//!
//! World frame: the road runs along y = 0 with a second lane at y = 3.5; the crossing street comes from the south at
//! x = 60, so that it has the right of way over the road.

use std::sync::Arc;

use ds_effect::Setting;
use ds_sim::{IdmScope, Manners, SimConfig, Simulation};
use ds_space::{DVec2, PoseSe2, SimTime, Tick};
use ds_world::{
    AgentClass, AgentState, Crosswalk, Lane, LaneKind, LightState, Map, Scene, Size, Track, TrackPoint, Trajectory,
    TrajectoryPoint, WorldState,
};

use crate::street::{CAR, PERSON, TICKS, add_light, expert, scene};

/// Returns a track along a line from a point, its distance a function of time.
pub(crate) fn line(
    class: AgentClass,
    size: Size,
    from: [f64; 2],
    heading_rad: f64,
    along: impl Fn(f64) -> f64,
) -> Track {
    let direction = DVec2::from_angle(heading_rad);
    let points = (0..TICKS).map(|tick| {
        let secs = f64::from(tick) * 0.1;
        let pose = PoseSe2 { position: DVec2::from(from) + direction * along(secs), heading_rad };
        let velocity_mps = direction * ((along(secs + 0.01) - along(secs - 0.01)) / 0.02);
        Some(TrackPoint { pose, z_m: 0.0, velocity_mps })
    });
    Track { name: format!("{class:?} {from:?}"), class, size, points: points.collect() }
}

/// Returns a car eastwards along the road.
pub(crate) fn car(from_m: f64, left_m: f64, speed_mps: f64) -> Track {
    line(AgentClass::Vehicle, CAR, [from_m, left_m], 0.0, move |t| speed_mps * t)
}

/// Returns somebody who crosses the road northwards at a place, stepping on it after some seconds.
pub(crate) fn walker(at_m: f64, after_secs: f64) -> Track {
    let from_m = 4.0 + 1.4 * after_secs;
    line(AgentClass::Pedestrian, PERSON, [at_m, -from_m], std::f64::consts::FRAC_PI_2, |t| 1.4 * t)
}

/// Returns a road of two lanes with a crossing street and a crosswalk at x = 100.
pub(crate) fn road(tracks: Vec<Track>) -> Scene {
    let mut scene = scene(0.0, expert(0.0, |t| -60.0 + 5.0 * t), tracks);
    let lane = |from: [f64; 2], to: [f64; 2]| Lane {
        name: format!("{from:?}"),
        kind: LaneKind::Road,
        centre_line: vec![DVec2::from(from), DVec2::from(to)],
        polygon: Vec::new(),
        speed_limit_mps: None,
        successors: Vec::new(),
        predecessors: Vec::new(),
        left: None,
        right: None,
    };
    let lanes =
        vec![lane([-200.0, 0.0], [400.0, 0.0]), lane([-200.0, 3.5], [400.0, 3.5]), lane([60.0, -200.0], [60.0, 200.0])];
    let corners = [[98.0, -5.0], [102.0, -5.0], [102.0, 8.0], [98.0, 8.0]];
    let crosswalks = vec![Crosswalk { polygon: corners.map(DVec2::from).to_vec() }];
    scene.map = Map { lanes, crosswalks, ..Map::default() };
    scene
}

/// Returns a road on which everything happens at once.
pub(crate) fn town() -> Scene {
    let mut tracks = vec![
        car(10.0, 0.0, 4.0),
        car(120.0, 0.0, 6.0),
        car(-12.0, 0.0, 9.0),
        car(-45.0, 3.5, 9.0),
        car(-80.0, 3.5, 10.0),
        car(-30.0, 0.0, 8.0),
        walker(100.0, 8.0),
        walker(100.0, 13.0),
        walker(140.0, 9.0),
        walker(150.0, 14.0),
        walker(30.0, 4.5),
        walker(35.0, 6.5),
    ];
    for k in 0..4 {
        let from = [60.0, -70.0 - 30.0 * f64::from(k)];
        tracks.push(line(AgentClass::Vehicle, CAR, from, std::f64::consts::FRAC_PI_2, |t| 9.0 * t));
    }
    let mut scene = road(tracks);
    let states = (0..TICKS).map(|tick| if tick < 120 { LightState::Red } else { LightState::Green });
    add_light(&mut scene, 170.0, states.collect());
    scene
}

/// Returns a configuration in which all agents react.
pub(crate) fn config(manners: Manners, effects: Vec<Setting>) -> SimConfig {
    SimConfig { agents: Some(IdmScope::All), manners, effects, ..SimConfig::default() }
}

fn slow_plan() -> Trajectory {
    let points = (1..=8).map(|i| {
        let secs = 0.5 * f64::from(i);
        TrajectoryPoint { after: SimTime::from_secs(secs), pose: PoseSe2::new(5.0 * secs, 0.0, 0.0) }
    });
    Trajectory::new(points.collect()).expect("the plan is sound")
}

/// Drives 20 s with a slow ego and returns every state, restoring before one tick.
pub(crate) fn drive(scene: &Arc<Scene>, config: &SimConfig, restore_at: Option<u32>) -> Vec<WorldState> {
    let mut simulation = Simulation::new(scene.clone(), config.clone(), Tick(0)).expect("the scene is sound");
    (0..TICKS - 1)
        .map(|tick| {
            if tick % 5 == 0 {
                simulation.begin_plan(&slow_plan());
            }
            if restore_at == Some(tick) {
                let bytes = simulation.snapshot();
                simulation = Simulation::restore(scene.clone(), config.clone(), &bytes).expect("its own snapshot");
            }
            simulation.step().clone()
        })
        .collect()
}

/// Returns the states of one agent while it is there.
pub(crate) fn of(states: &[WorldState], agent: usize) -> Vec<AgentState> {
    states.iter().filter_map(|state| state.agents.iter().find(|a| a.id.0 as usize == agent).cloned()).collect()
}

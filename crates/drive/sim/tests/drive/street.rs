//! Scenes for tests and benches, made by formula: a road along an arc, traffic along it, an expert that drives it.
//!
//! World frame, the road starts at the origin eastwards. Not a scenario format: `ds-scenario` has those.

use std::sync::Arc;

use ds_space::{DVec2, DVec3, Digest, PoseSe2, SimTime, Tick};
use ds_world::{
    AgentClass, EgoState, Lane, LaneId, LaneKind, LightState, Map, Origin, Scene, Size, StopLine, Track, TrackPoint,
    TrafficLight, Trajectory, TrajectoryPoint, VehicleParameters,
};

/// Ticks of every scene (20 s and the initial state).
pub(crate) const TICKS: u32 = 201;
pub(crate) const CAR: Size = Size { length_m: 4.5, width_m: 1.9, height_m: 1.6 };
pub(crate) const PERSON: Size = Size { length_m: 0.6, width_m: 0.6, height_m: 1.8 };

/// Returns the pose at a distance along an arc through the origin, at an offset to its left.
pub(crate) fn on_arc(curvature_per_m: f64, along_m: f64, left_m: f64) -> PoseSe2 {
    let heading_rad = curvature_per_m * along_m;
    let centre = if curvature_per_m.abs() < 1e-9 {
        DVec2::new(along_m, 0.0)
    } else {
        DVec2::new(heading_rad.sin(), 1.0 - heading_rad.cos()) / curvature_per_m
    };
    let pose = PoseSe2 { position: centre, heading_rad: ds_space::angle::wrap(heading_rad) };
    PoseSe2 { position: pose.to_outer(DVec2::new(0.0, left_m)), ..pose }
}

/// Returns a drive along an arc whose distance is a function of time in seconds.
pub(crate) fn expert(curvature_per_m: f64, along_m: impl Fn(f64) -> f64) -> Vec<EgoState> {
    let moved = |secs: f64| (along_m(secs + 0.01) - along_m(secs - 0.01)) / 0.02;
    (0..TICKS)
        .map(|tick| {
            let secs = f64::from(tick) * 0.1;
            let speed_mps = moved(secs);
            EgoState {
                pose: on_arc(curvature_per_m, along_m(secs), 0.0),
                velocity_mps: DVec2::new(speed_mps, 0.0),
                yaw_rate_radps: curvature_per_m * speed_mps,
                acceleration_mps2: DVec2::new((moved(secs + 0.01) - moved(secs - 0.01)) / 0.02, 0.0),
                ..EgoState::default()
            }
        })
        .collect()
}

/// Returns a track along an arc at an offset, its distance a function of time.
pub(crate) fn track(
    class: AgentClass,
    size: Size,
    curvature_per_m: f64,
    left_m: f64,
    along_m: impl Fn(f64) -> f64,
) -> Track {
    let pose = |secs: f64| on_arc(curvature_per_m, along_m(secs), left_m);
    let points = (0..TICKS)
        .map(|tick| {
            let secs = f64::from(tick) * 0.1;
            let velocity_mps = (pose(secs + 0.01).position - pose(secs - 0.01).position) / 0.02;
            Some(TrackPoint { pose: pose(secs), z_m: 0.0, velocity_mps })
        })
        .collect();
    Track { name: format!("{class:?} {left_m}"), class, size, points }
}

/// Returns a scene on an arc with one lane along it.
pub(crate) fn scene(curvature_per_m: f64, ego_log: Vec<EgoState>, tracks: Vec<Track>) -> Scene {
    let centre_line: Vec<DVec2> =
        (-20..=160).map(|i| on_arc(curvature_per_m, f64::from(i) * 2.0, 0.0).position).collect();
    let lane = Lane {
        name: "lane".to_owned(),
        kind: LaneKind::Road,
        centre_line: centre_line.clone(),
        polygon: Vec::new(),
        speed_limit_mps: None,
        successors: Vec::new(),
        predecessors: Vec::new(),
        left: None,
        right: None,
    };
    Scene {
        adversary: None,
        name: "street".to_owned(),
        family: String::new(),
        digest: Digest::of(b"street"),
        dt: SimTime::from_secs(0.1),
        map: Map { lanes: vec![lane], ..Map::default() },
        vehicle: VehicleParameters::ZOE,
        ego_log,
        route: centre_line,
        tracks,
        cameras: Vec::new(),
        prompt: String::new(),
        origin: Origin::default(),
    }
}

/// Adds a stop line with a light across the lane of an eastward straight road.
pub(crate) fn add_light(scene: &mut Scene, x_m: f64, states: Vec<LightState>) {
    let light = scene.map.traffic_lights.len() as u32;
    scene.map.traffic_lights.push(TrafficLight {
        position: DVec3::new(x_m + 10.0, 0.0, 5.0),
        facing_rad: std::f64::consts::PI,
        lanes: vec![LaneId(0)],
        states,
    });
    let points = [DVec2::new(x_m, -8.0), DVec2::new(x_m, 8.0)];
    scene.map.stop_lines.push(StopLine { points, light: Some(light) });
}

/// Returns a street as crowded as the busiest recorded ones: two directions of moving cars, cyclists, people on both
/// sides, parked cars, cones and a light; `moving` cars in a ring of three rows each way.
pub(crate) fn crowded(moving: u32) -> Scene {
    let mut tracks = Vec::new();
    for i in 0..moving {
        let (row, place) = (i % 3, i / 3);
        let speed_mps = 6.0 + f64::from(i % 5);
        let start_m = 15.0 * f64::from(place) - 60.0;
        let left_m = if row == 0 { 0.0 } else { 3.5 * f64::from(row) };
        if row == 0 && (start_m + 4.0).abs() < 10.0 {
            continue;
        }
        tracks.push(track(AgentClass::Vehicle, CAR, 0.0, left_m, move |t| start_m + speed_mps * t));
    }
    for i in 0..30 {
        let place_m = 9.0 * f64::from(i) - 40.0;
        tracks.push(track(AgentClass::Vehicle, CAR, 0.0, -4.0, move |_| place_m));
        tracks.push(track(AgentClass::Pedestrian, PERSON, 0.0, 12.0, move |t| place_m + 1.2 * t));
        tracks.push(track(AgentClass::Cone, PERSON, 0.0, 10.5, move |_| place_m));
    }
    for i in 0..5 {
        let start_m = 20.0 * f64::from(i);
        tracks.push(track(AgentClass::Cyclist, PERSON, 0.0, -2.2, move |t| start_m + 4.0 * t));
    }
    let mut scene = scene(0.0, expert(0.0, |t| 8.0 * t), tracks);
    let states = (0..TICKS).map(|tick| if tick < 80 { LightState::Red } else { LightState::Green }).collect();
    add_light(&mut scene, 120.0, states);
    scene
}

/// Returns the rest of the log as a plan of 8 s at 0.5 s, in the rig of an ego at `pose` and `tick`.
pub(crate) fn expert_plan(scene: &Scene, tick: Tick, pose: &PoseSe2) -> Trajectory {
    let points = (1..=16)
        .map(|i| TrajectoryPoint {
            after: SimTime::from_secs(f64::from(i) * 0.5),
            pose: pose.relative(&scene.logged_ego(tick.plus(5 * i)).pose),
        })
        .collect();
    Trajectory::new(points).expect("logs of these scenes are sound")
}

/// Returns a scene ready to be simulated.
pub(crate) fn shared(scene: Scene) -> Arc<Scene> {
    Arc::new(scene)
}

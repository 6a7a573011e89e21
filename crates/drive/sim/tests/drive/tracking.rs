//! How closely the ego follows plans: straight, circle, stop, standing start; invariance under rigid motion.

use ds_sim::{DynamicsKind, SimConfig, Simulation, TrackerKind};
use ds_space::{DVec2, PoseSe2, SimTime, Tick};
use ds_world::{EgoState, Scene, Trajectory, TrajectoryPoint};

use crate::street::{expert, expert_plan, scene, shared};

/// The largest errors of a drive after its first second.
#[derive(Debug, Default)]
struct Errors {
    lateral_m: f64,
    heading_rad: f64,
    along_m: f64,
}

/// Replays the expert through plans every 5 ticks for 10 s and returns the errors against the log.
fn replay_expert(scene: Scene, config: &SimConfig) -> (Errors, EgoState) {
    let scene = shared(scene);
    let mut simulation = Simulation::new(scene.clone(), config.clone(), Tick(0)).expect("the scene is sound");
    let mut errors = Errors::default();
    for tick in 0..100 {
        if tick % 5 == 0 {
            let plan = expert_plan(&scene, Tick(tick), &simulation.state().ego.pose);
            simulation.begin_plan(&plan);
        }
        let ego = simulation.step().ego;
        let logged = scene.logged_ego(Tick(tick + 1));
        let offset = logged.pose.relative(&ego.pose);
        if tick >= 10 {
            errors.lateral_m = errors.lateral_m.max(offset.position.y.abs());
            errors.heading_rad = errors.heading_rad.max(offset.heading_rad.abs());
            errors.along_m = errors.along_m.max(offset.position.x.abs());
        }
    }
    (errors, simulation.state().ego)
}

fn configs() -> Vec<SimConfig> {
    let mut all = Vec::new();
    for tracker in [TrackerKind::Lqr, TrackerKind::PurePursuit] {
        for dynamics in [DynamicsKind::SingleTrack, DynamicsKind::Kinematic] {
            all.push(SimConfig { tracker, dynamics, agents: None, ..SimConfig::default() });
        }
    }
    all
}

#[test]
fn expert_replay_stays_close() {
    // Curvature, speed, bounds of the lateral and the longitudinal error.
    for (curvature_per_m, speed_mps, lateral_m, along_m) in [
        (0.0, 3.0, 0.01, 0.3),
        (0.0, 10.0, 0.01, 0.3),
        (0.0, 25.0, 0.01, 0.3),
        (0.02, 8.0, 0.25, 0.5),
        (-0.05, 5.0, 0.3, 0.5),
        (0.005, 20.0, 0.4, 0.7),
    ] {
        for config in configs() {
            let log = expert(curvature_per_m, |t| speed_mps * t);
            let (errors, _) = replay_expert(scene(curvature_per_m, log, Vec::new()), &config);
            let close = errors.lateral_m <= lateral_m && errors.along_m <= along_m && errors.heading_rad <= 0.06;
            assert!(close, "curvature {curvature_per_m}, {speed_mps} m/s, {config:?}: {errors:?}");
        }
    }
}

#[test]
fn stops_where_the_plan_stops_and_stays() {
    // From 8 m/s to a stand within 4 s, at 16 m.
    let along = |t: f64| if t < 4.0 { 8.0 * t - t * t } else { 16.0 };
    for config in configs() {
        let (errors, ego) = replay_expert(scene(0.0, expert(0.0, along), Vec::new()), &config);
        assert!(ego.speed_mps().abs() < 0.05, "{config:?}: still at {} m/s", ego.speed_mps());
        assert!((ego.pose.position.x - 16.0).abs() < 1.5, "{config:?}: stands at {} m", ego.pose.position.x);
        assert!(errors.lateral_m < 0.01, "{config:?}: {errors:?}");
    }
}

#[test]
fn starts_from_a_stand() {
    let along = |t: f64| if t < 4.0 { 0.75 * t * t } else { 12.0 + 6.0 * (t - 4.0) };
    for config in configs() {
        let (errors, ego) = replay_expert(scene(0.0, expert(0.0, along), Vec::new()), &config);
        assert!((ego.speed_mps() - 6.0).abs() < 0.3 && errors.along_m < 1.5, "{config:?}: {errors:?}");
    }
}

#[test]
fn a_plan_that_ends_brings_the_car_to_a_stand() {
    for config in configs() {
        let scene = shared(scene(0.0, expert(0.0, |t| 10.0 * t), Vec::new()));
        let mut simulation = Simulation::new(scene, config.clone(), Tick(0)).expect("the scene is sound");
        let point = TrajectoryPoint { after: SimTime::from_secs(0.5), pose: PoseSe2::new(5.0, 0.0, 0.0) };
        simulation.begin_plan(&Trajectory::new(vec![point]).expect("the plan is sound"));
        (0..120).for_each(|_| {
            simulation.step();
        });
        assert!(simulation.state().ego.speed_mps().abs() < 0.05, "{config:?}: {:?}", simulation.state().ego);
    }
}

#[test]
fn following_the_log_is_exact() {
    let scene = shared(scene(0.02, expert(0.02, |t| 8.0 * t), Vec::new()));
    let mut simulation = Simulation::new(scene.clone(), SimConfig::default(), Tick(3)).expect("the scene is sound");
    for tick in 4..260 {
        let ego = simulation.step().ego;
        let logged = scene.logged_ego(Tick(tick));
        assert_eq!((ego.pose, ego.velocity_mps), (logged.pose, logged.velocity_mps), "tick {tick}");
    }
}

#[test]
fn a_moved_and_turned_world_gives_the_moved_and_turned_drive() {
    let frame = PoseSe2::new(-300.0, 120.0, 2.1);
    let build = || scene(0.03, expert(0.03, |t| 7.0 * t), Vec::new());
    let mut moved = build();
    moved.ego_log.iter_mut().for_each(|ego| ego.pose = frame.compose(&ego.pose));
    moved.route.iter_mut().for_each(|point: &mut DVec2| *point = frame.to_outer(*point));
    for config in configs() {
        let here = replay_expert(build(), &config).1;
        let there = replay_expert(moved.clone(), &config).1;
        let back = frame.relative(&there.pose);
        assert!((back.position - here.pose.position).length() < 1e-6, "{config:?}");
        assert!((there.velocity_mps - here.velocity_mps).length() < 1e-6, "{config:?}");
    }
}

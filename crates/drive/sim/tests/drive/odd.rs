//! Scenes and plans that no one would draw: nothing panics, nothing explodes, no number is lost.

use ds_sim::{DynamicsKind, IdmScope, SimConfig, SimError, Simulation, TrackerKind};
use ds_space::{DVec2, PoseSe2, SimTime, Tick};
use ds_world::{AgentClass, RouteCommand, Trajectory, TrajectoryPoint, WorldState};
use proptest::prelude::*;

use crate::street::{CAR, crowded, expert, scene, shared, track};

fn sound(state: &WorldState) -> bool {
    let ego = &state.ego;
    let agents = state.agents.iter().all(|agent| agent.pose.is_finite() && agent.velocity_mps.length() < 61.0);
    let closing = state.contacts.iter().all(|contact| contact.closing_speed_mps.is_finite());
    ego.is_finite()
        && ego.speed_mps() <= 70.0
        && ego.speed_mps() >= -5.0
        && ego.steering_rad.abs() <= 0.6
        && agents
        && closing
}

/// Anything that a trajectory may be: far points, jumps, spins, tiny and long steps.
fn wild_plans() -> impl Strategy<Value = Trajectory> {
    let point = (
        1i64..2_000_000_000,
        -1400.0..1400.0f64,
        -1400.0..1400.0f64,
        -50.0..50.0f64,
        prop_oneof![Just(1.0), Just(1e-3), Just(0.0)],
    );
    proptest::collection::vec(point, 1..12).prop_map(|points| {
        let mut after = SimTime(0);
        let points = points.into_iter().map(|(nanos, x_m, y_m, heading_rad, scale)| {
            after = after + SimTime(nanos);
            TrajectoryPoint { after, pose: PoseSe2::new(scale * x_m, scale * y_m, heading_rad) }
        });
        Trajectory::new(points.collect()).expect("within the limits")
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn no_plan_makes_the_world_unsound(plans in proptest::collection::vec(wild_plans(), 4), choice in 0u32..4) {
        let tracker = if choice % 2 == 0 { TrackerKind::Lqr } else { TrackerKind::PurePursuit };
        let dynamics = if choice < 2 { DynamicsKind::SingleTrack } else { DynamicsKind::Kinematic };
        let agents = Some(IdmScope::All);
        let config = SimConfig { tracker, dynamics, agents, ..SimConfig::default() };
        let mut simulation = Simulation::new(shared(crowded(9)), config, Tick(0)).expect("the scene is sound");
        for (i, plan) in plans.iter().enumerate() {
            simulation.begin_plan(plan);
            for _ in 0..[3, 40, 7, 60][i] {
                prop_assert!(sound(simulation.step()), "{:?}", simulation.state().ego);
            }
        }
        prop_assert_eq!(simulation.ego_estimate(), simulation.state().ego);
    }
}

#[test]
fn odd_scenes_run() {
    let empty = scene(0.0, expert(0.0, |t| 5.0 * t), Vec::new());
    let mut lost = empty.clone();
    lost.map.lanes.clear();
    lost.route.clear();
    lost.ego_log.iter_mut().for_each(|ego| ego.pose.position += DVec2::new(4e6, -4e6));
    let overlapping =
        scene(0.0, expert(0.0, |t| 5.0 * t), vec![track(AgentClass::Vehicle, CAR, 0.0, 0.0, |t| 1.0 + 5.0 * t)]);
    let mut gaps = overlapping.clone();
    gaps.tracks[0].points.iter_mut().enumerate().filter(|(i, _)| i % 7 < 3).for_each(|(_, point)| *point = None);
    let mut short = overlapping.clone();
    short.tracks[0].points.truncate(1);
    let mut never = overlapping.clone();
    never.tracks[0].points.clear();
    let mut brief = empty.clone();
    brief.ego_log.truncate(1);
    for (what, scene) in [
        ("empty", empty),
        ("off every map", lost),
        ("overlapping", overlapping),
        ("gaps", gaps),
        ("seen once", short),
        ("never seen", never),
        ("one tick of log", brief),
    ] {
        for scope in [IdmScope::All, IdmScope::BehindEgo] {
            let config = SimConfig { agents: Some(scope), ..SimConfig::default() };
            let mut simulation = Simulation::new(shared(scene.clone()), config, Tick(0)).expect(what);
            assert_eq!(!simulation.state().contacts.is_empty(), matches!(what, "overlapping" | "seen once"), "{what}");
            let point = TrajectoryPoint { after: SimTime::from_secs(4.0), pose: PoseSe2::new(20.0, 0.0, 0.0) };
            simulation.begin_plan(&Trajectory::new(vec![point]).expect("the plan is sound"));
            for _ in 0..250 {
                assert!(sound(simulation.step()), "{what}");
            }
            assert_eq!(simulation.route_command(), RouteCommand::Straight, "{what}");
        }
    }
}

#[test]
fn what_cannot_be_simulated_is_refused_by_name() {
    let base = scene(0.0, expert(0.0, |t| 5.0 * t), Vec::new());
    let mut no_log = base.clone();
    no_log.ego_log.clear();
    let mut frozen = base.clone();
    frozen.dt = SimTime(0);
    let mut bent = base.clone();
    bent.vehicle.wheel_base_m = f64::NAN;
    let mut broken = base.clone();
    broken.ego_log[3].pose.position.x = f64::INFINITY;
    for (scene, start, says) in [
        (no_log, 0, "empty ego log"),
        (frozen, 0, "time step is 0 s"),
        (bent, 0, "wheel_base_m"),
        (broken, 0, "ego_log"),
        (base, 500, "start tick 500"),
    ] {
        let refused: Result<Simulation, SimError> = Simulation::new(shared(scene), SimConfig::default(), Tick(start));
        let text = refused.expect_err(says).to_string();
        assert!(text.contains(says), "{text:?} does not say {says:?}");
    }
}

//! A lead vehicle brakes: what the oracle prefers, that it changes nothing, and how ties fall.

use std::sync::Arc;

use ds_scenario::Family;
use ds_sim::SimConfig;
use ds_space::{PoseSe2, Tick};

use super::*;

/// A lead vehicle brakes ahead of the ego.
fn braking() -> Simulation {
    let scene = Arc::new(ds_scenario::generate(Family::LeadBraking, 3));
    let mut simulation = Simulation::new(scene, SimConfig::default(), Tick(0)).expect("a simulation");
    for _ in 0..20 {
        simulation.step();
    }
    simulation
}

fn straight(speed_mps: f64, score: f64) -> Proposal {
    let point = |index: u32| TrajectoryPoint {
        after: SimTime::from_secs(0.5 * f64::from(index)),
        pose: PoseSe2::new(0.5 * f64::from(index) * speed_mps, 0.0, 0.0),
    };
    Proposal { trajectory: Trajectory::new((1..=8).map(point).collect()).expect("sound"), score }
}

fn logged(simulation: &Simulation) -> Proposal {
    let (scene, now) = (simulation.scene(), simulation.state());
    let point = |index: u32| TrajectoryPoint {
        after: SimTime::from_secs(0.5 * f64::from(index)),
        pose: now.ego.pose.relative(&scene.logged_ego(Tick(now.tick.0 + 5 * index)).pose),
    };
    Proposal { trajectory: Trajectory::new((1..=8).map(point).collect()).expect("sound"), score: 0.0 }
}

#[test]
fn the_experts_way_is_better_than_ramming_and_leaving_the_road() {
    let now = braking();
    let oracle = Oracle::new(now.scene()).expect("the scene can be scored");
    let proposals = [straight(30.0, 5.0), logged(&now), straight(-5.0, 1.0)];
    for agents in [AgentsIn::Reacting, AgentsIn::Open] {
        let ranked = oracle.rank(&now, &proposals, agents).expect("ranks");
        assert_eq!(ranked.chosen, 1, "{agents:?}: {:?}", ranked.scores);
        assert!(ranked.scores[1] > 0.3, "{agents:?}: {:?}", ranked.scores);
        assert!(ranked.scores.iter().all(|score| (0.0..=1.0).contains(score)));
    }
}

#[test]
fn ranking_changes_nothing_and_comes_out_alike() {
    let now = braking();
    let before = now.snapshot();
    let oracle = Oracle::new(now.scene()).expect("the scene can be scored");
    let proposals: Vec<Proposal> = (0..12).map(|index| straight(f64::from(index), 0.0)).collect();
    let first = oracle.rank(&now, &proposals, AgentsIn::Reacting).expect("ranks");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    let again = pool.install(|| oracle.rank(&now, &proposals, AgentsIn::Reacting)).expect("ranks");
    assert_eq!(first, again);
    assert_eq!(now.snapshot(), before);
}

#[test]
fn of_equals_the_policys_favourite_wins() {
    let now = braking();
    let oracle = Oracle::new(now.scene()).expect("the scene can be scored");
    let proposals = [straight(3.0, 0.0), straight(3.0, 2.0), straight(3.0, 1.0)];
    assert_eq!(oracle.rank(&now, &proposals, AgentsIn::Reacting).expect("ranks").chosen, 1);
    assert!(matches!(oracle.rank(&now, &[], AgentsIn::Open), Err(OracleError::Empty)));
}

//! Drives made by hand, their scores worked out by hand; invariance under rigid motion.

use ds_space::{Digest, PoseSe2, SimTime};
use ds_world::{EgoState, Map, Origin, VehicleParameters};
use proptest::prelude::*;

use super::*;

/// A straight road 200 m long; the expert drives 10 m/s from the origin for 10 s.
fn scene() -> Scene {
    Scene {
        adversary: None,
        name: "road".to_owned(),
        family: String::new(),
        digest: Digest::default(),
        dt: SimTime::from_secs(0.1),
        map: Map::default(),
        vehicle: VehicleParameters::ZOE,
        ego_log: (0..=100).map(|i| at(f64::from(i))).collect(),
        route: vec![DVec2::new(-10.0, 0.0), DVec2::new(190.0, 0.0)],
        tracks: Vec::new(),
        cameras: Vec::new(),
        prompt: String::new(),
        origin: Origin::default(),
    }
}

fn at(x_m: f64) -> EgoState {
    EgoState { pose: PoseSe2::new(x_m, 0.0, 0.0), ..EgoState::default() }
}

/// Drives from a tick to another, `along_m` giving how far the ego is at each.
fn driven(scene: &Scene, ticks: std::ops::RangeInclusive<u32>, along_m: impl Fn(u32) -> f64) -> Option<f64> {
    let mut progress = Progress::new(scene);
    assert_eq!(progress.score(), None);
    ticks.for_each(|tick| progress.observe(Tick(tick), DVec2::new(along_m(tick), 0.3)));
    progress.score()
}

#[test]
fn by_table() {
    // Metres per tick of the ego, first and last tick, score: the expert makes 1 m a tick.
    for (step_m, first, last, expected) in [
        (0.5, 0, 40, Some(0.5)),
        (1.25, 0, 40, Some(1.0)),
        (-0.1, 0, 40, Some(0.0)),
        (0.75, 20, 60, Some(0.75)),
        (0.25, 0, 1, Some(0.25)),
        (0.5, 0, 0, None),
        (0.5, 100, 140, None),
    ] {
        let score = driven(&scene(), first..=last, |tick| f64::from(first) + step_m * f64::from(tick - first));
        match (score, expected) {
            (Some(score), Some(expected)) => assert!((score - expected).abs() < 1e-12, "{step_m}: {score}"),
            _ => assert_eq!(score, expected, "{step_m} from {first} to {last}"),
        }
    }
}

#[test]
fn where_the_expert_stands_it_does_not_apply() {
    let mut standing = scene();
    standing.ego_log.iter_mut().for_each(|ego| ego.pose = PoseSe2::default());
    let mut bare = standing.clone();
    bare.route.clear();
    for scene in [standing, bare] {
        assert_eq!(driven(&scene, 0..=30, |_| 0.0), None);
    }
}

#[test]
fn a_loop_is_read_in_order() {
    // A square of 60 m that comes back to its start and goes on along its first side.
    let corners = [(0.0, 0.0), (60.0, 0.0), (60.0, 60.0), (0.0, 60.0), (0.0, 0.0), (60.0, 0.0)];
    let route = Polyline::new(&corners.map(|(x, y)| DVec2::new(x, y))).expect("a line");
    let mut odometer = Odometer { along_m: 0.0 };
    for i in 0..=145 {
        let along_m = 2.0 * f64::from(i);
        let read_m = odometer.read(&route, route.at(along_m) + DVec2::new(0.1, 0.1));
        assert!((read_m - along_m).abs() < 0.3, "{read_m} at {along_m}");
    }
}

proptest! {
    #[test]
    fn a_moved_and_turned_world_scores_the_same(
        x in -500.0..500.0f64, y in -500.0..500.0f64, heading in -3.0..3.0f64,
        speed in 0.0..1.4f64, drift in -0.08..0.08f64,
    ) {
        let frame = PoseSe2::new(x, y, heading);
        let here = scene();
        let mut there = here.clone();
        there.ego_log.iter_mut().for_each(|ego| ego.pose = frame.compose(&ego.pose));
        there.route.iter_mut().for_each(|point| *point = frame.to_outer(*point));
        let (mut a, mut b) = (Progress::new(&here), Progress::new(&there));
        for tick in 0..=60 {
            let position = DVec2::new(speed, drift) * f64::from(tick);
            a.observe(Tick(tick), position);
            b.observe(Tick(tick), frame.to_outer(position));
        }
        let (a, b) = (a.score().expect("it applies"), b.score().expect("it applies"));
        prop_assert!((a - b).abs() < 1e-9, "{a} {b}");
    }
}

//! Drives made by hand, their scores worked out by hand; invariance under rigid motion.

use ds_space::{AgentId, DVec2, Digest, PoseSe2, SimTime, Tick};
use ds_world::{Contact, ContactKind, EgoState, Map, Origin, Scene, VehicleParameters, WorldState};
use proptest::prelude::*;

use super::*;

/// A straight road 200 m long and 7 m wide; the expert drives 10 m/s from the origin for 10 s.
fn scene() -> Scene {
    let at = |x: f64, y: f64| DVec2::new(x, y);
    let road = vec![at(-10.0, -3.5), at(190.0, -3.5), at(190.0, 3.5), at(-10.0, 3.5)];
    Scene {
        name: "road".to_owned(),
        family: String::new(),
        digest: Digest::default(),
        dt: SimTime::from_secs(0.1),
        map: Map { drivable: vec![road], ..Map::default() },
        vehicle: VehicleParameters::ZOE,
        ego_log: (0..=100).map(|i| ego(f64::from(i), 0.0)).collect(),
        route: vec![at(-10.0, 0.0), at(190.0, 0.0)],
        tracks: Vec::new(),
        cameras: Vec::new(),
        prompt: String::new(),
        origin: Origin::default(),
    }
}

fn ego(x_m: f64, y_m: f64) -> EgoState {
    EgoState { pose: PoseSe2::new(x_m, y_m, 0.0), velocity_mps: DVec2::new(10.0, 0.0), ..EgoState::default() }
}

fn state(tick: u32, ego: EgoState, contacts: Vec<Contact>) -> WorldState {
    WorldState { tick: Tick(tick), time: SimTime(0), ego, agents: Vec::new(), lights: Vec::new(), contacts }
}

fn contact(agent: u32, at_fault: bool) -> Contact {
    Contact { agent: AgentId(agent), kind: ContactKind::Side, at_fault, closing_speed_mps: 1.0 }
}

#[test]
fn half_the_speed_is_half_the_progress_and_a_fifth_of_the_route() {
    let mut tracker = ScoreTracker::new(&scene());
    assert_eq!(tracker.finish(), EpisodeScore::default());
    // 5 m/s for 4 s from tick 0: 20 m of the expert's 40 m and of the whole 100 m.
    for tick in 0..=40 {
        tracker.observe(&state(tick, ego(0.5 * f64::from(tick), 0.3), Vec::new()));
    }
    let score = tracker.finish();
    assert_eq!((score.ticks, score.collision, score.drivable_area), (41, Some(1.0), Some(1.0)));
    assert!((score.progress.expect("it applies") - 0.5).abs() < 1e-12);
    assert!((score.route_completion.expect("it applies") - 0.2).abs() < 1e-12);
    assert_eq!((score.driving_score, score.first_contact), (None, None));
}

#[test]
fn what_is_driven_beside_the_route_does_not_count() {
    let mut tracker = ScoreTracker::new(&scene());
    for tick in 0..=40 {
        // 10 m/s along the road; from 20 m on 5 m beside it, from 30 m on back on it.
        let beside_m = if (20..30).contains(&tick) { 5.0 } else { 0.0 };
        tracker.observe(&state(tick, ego(f64::from(tick), beside_m), Vec::new()));
    }
    let score = tracker.finish();
    assert!((score.route_completion.expect("it applies") - 0.19).abs() < 1e-12, "19 m of 100 m before leaving");
    assert!((score.progress.expect("it applies") - 1.0).abs() < 1e-12);
}

#[test]
fn a_drive_that_begins_later_is_measured_from_there() {
    let mut tracker = ScoreTracker::new(&scene());
    for tick in 20..=60 {
        tracker.observe(&state(tick, ego(20.0 + 0.75 * f64::from(tick - 20), 0.0), Vec::new()));
    }
    // 30 m of the expert's 40 m, and of the 80 m left at tick 20.
    let score = tracker.finish();
    assert!((score.progress.expect("it applies") - 0.75).abs() < 1e-12);
    assert!((score.route_completion.expect("it applies") - 0.375).abs() < 1e-12);
}

#[test]
fn corners_off_the_road_count_per_state() {
    // Half a car is 0.865 m wide: the edge of the 7 m road is crossed beyond 2.635 m, and 0.2 m are forgiven.
    let mut tracker = ScoreTracker::new(&scene());
    let offsets = [(0.0, 1.0), (2.6, 1.0), (2.8, 1.0), (2.9, 0.0), (-2.9, 0.0), (9.0, 0.0), (-2.8, 1.0), (0.0, 1.0)];
    for (tick, (offset_m, expected)) in (0..).zip(offsets) {
        let score = tracker.observe(&state(tick, ego(50.0, offset_m), Vec::new()));
        assert_eq!(score.drivable_area, Some(expected), "{offset_m} m aside");
    }
    assert_eq!(tracker.finish().drivable_area, Some(5.0 / 8.0));
}

#[test]
fn only_own_fault_costs_and_first_overlaps_are_left_out() {
    let mut tracker = ScoreTracker::new(&scene());
    let contacts = [
        vec![contact(3, true)],
        vec![contact(3, true)],
        vec![contact(3, true), contact(5, false)],
        vec![contact(6, true)],
        vec![],
    ];
    let expected =
        [(1.0, None, None), (1.0, None, None), (1.0, Some(2), None), (0.0, Some(2), Some(3)), (1.0, Some(2), Some(3))];
    for (tick, (contacts, (now, any, fault))) in (0..).zip(contacts.into_iter().zip(expected)) {
        assert_eq!(tracker.observe(&state(tick, ego(0.0, 0.0), contacts)).collision, now, "tick {tick}");
        let score = tracker.finish();
        assert_eq!((score.first_contact, score.first_at_fault_contact), (any.map(Tick), fault.map(Tick)));
        assert_eq!(score.collision, Some(if fault.is_some() { 0.0 } else { 1.0 }));
    }
}

#[test]
fn what_does_not_apply_is_none() {
    let mut standing = scene();
    standing.ego_log.iter_mut().for_each(|ego| ego.pose = PoseSe2::default());
    let mut bare = standing.clone();
    bare.map = Map::default();
    bare.route.clear();
    for (scene, drivable_area) in [(standing, Some(1.0)), (bare, None)] {
        let mut tracker = ScoreTracker::new(&scene);
        for tick in 0..30 {
            tracker.observe(&state(tick, ego(0.0, 0.0), Vec::new()));
        }
        let score = tracker.finish();
        assert_eq!((score.progress, score.route_completion), (None, None));
        assert_eq!((score.drivable_area, score.collision), (drivable_area, Some(1.0)));
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
        there.map.drivable[0].iter_mut().for_each(|point| *point = frame.to_outer(*point));
        let (mut a, mut b) = (ScoreTracker::new(&here), ScoreTracker::new(&there));
        let mut previous = 0.0;
        for tick in 0..=60 {
            let mut ego = ego(speed * f64::from(tick), drift * f64::from(tick));
            a.observe(&state(tick, ego, Vec::new()));
            ego.pose = frame.compose(&ego.pose);
            b.observe(&state(tick, ego, Vec::new()));
            let completed = a.finish().route_completion.expect("it applies");
            prop_assert!(completed >= previous && completed <= 1.0);
            previous = completed;
        }
        let (a, b) = (a.finish(), b.finish());
        let close = |a: Option<f64>, b: Option<f64>, tolerance: f64| (a.expect("applies") - b.expect("applies")).abs() <= tolerance;
        prop_assert!(close(a.progress, b.progress, 1e-9) && close(a.route_completion, b.route_completion, 1e-9));
        // A corner within rounding of the border may fall on either side in one state.
        prop_assert!(close(a.drivable_area, b.drivable_area, 1.0 / 61.0 + 1e-9), "{a:?} {b:?}");
    }
}

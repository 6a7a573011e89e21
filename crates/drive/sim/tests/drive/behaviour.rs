//! What agents decide: lane changes by MOBIL, yielding by right of way, stepping on the road; each off by default.

use std::collections::BTreeMap;

use ds_effect::Setting;
use ds_sim::Manners;
use ds_world::{AgentState, Track};

use crate::street::shared;
use crate::town::{self, car, config, line, road, town, walker};

const LANE_CHANGE: Manners = Manners { lane_change: true, yielding: false, walking: false };

fn drive(tracks: Vec<Track>, manners: Manners, effects: &[(&str, &[f64])]) -> Vec<Vec<AgentState>> {
    let count = tracks.len();
    let settings = effects.iter().map(|(id, values)| Setting::new(id, values).expect("a sound setting"));
    let states = town::drive(&shared(road(tracks)), &config(manners, settings.collect()), None);
    (0..count).map(|agent| town::of(&states, agent)).collect()
}

fn left_most(states: &[AgentState]) -> f64 {
    states.iter().map(|state| state.pose.position.y).fold(f64::NEG_INFINITY, f64::max)
}

#[test]
fn a_driver_behind_a_slow_one_changes_to_a_free_lane() {
    let tracks = || vec![car(20.0, 0.0, 4.0), car(0.0, 0.0, 10.0)];
    let stays = drive(tracks(), Manners::default(), &[]);
    assert_eq!(left_most(&stays[1]), 0.0);
    // A selfish one: a polite slow driver would make room first.
    let changes = drive(tracks(), LANE_CHANGE, &[("lane_change_politeness", &[0.0])]);
    assert!((left_most(&changes[1]) - 3.5).abs() < 0.05, "{}", left_most(&changes[1]));
    assert_eq!(left_most(&changes[0]), 0.0, "the slow one stays");
    let last = |agent: &[AgentState]| agent.last().expect("present").pose.position.x;
    assert!(last(&changes[1]) > last(&changes[0]) + 20.0, "it did not overtake");
}

#[test]
fn nobody_changes_before_a_fast_one_close_behind() {
    let beside = drive(vec![car(20.0, 0.0, 4.0), car(0.0, 0.0, 6.0), car(-2.0, 3.5, 6.0)], LANE_CHANGE, &[]);
    let early = &beside[1][..20];
    assert!(left_most(early) < 0.5, "it cut in at once: {}", left_most(early));
}

#[test]
fn politeness_holds_back_a_change_that_costs_others() {
    let tracks = || vec![car(25.0, 0.0, 6.5), car(0.0, 0.0, 9.0), car(-32.0, 3.5, 14.0), car(-60.0, 3.5, 14.0)];
    let first = |politeness: f64| {
        let states = drive(tracks(), LANE_CHANGE, &[("lane_change_politeness", &[politeness])]);
        states[1].iter().position(|state| state.pose.position.y > 0.5).unwrap_or(usize::MAX)
    };
    assert!(first(0.0) < first(1.0), "{} and {}", first(0.0), first(1.0));
}

#[test]
fn the_one_from_the_left_yields_unless_it_never_does() {
    let crossing = || {
        line(ds_world::AgentClass::Vehicle, crate::street::CAR, [60.0, -60.0], std::f64::consts::FRAC_PI_2, |t| 8.0 * t)
    };
    let tracks = || vec![car(0.0, 0.0, 8.0), crossing()];
    let yielding = Manners { yielding: true, ..Manners::default() };
    let apart = |effects: &[(&str, &[f64])], manners: Manners| {
        let states = drive(tracks(), manners, effects);
        let gap = |(a, b): (&AgentState, &AgentState)| a.pose.position.distance(b.pose.position);
        states[0].iter().zip(&states[1]).map(gap).fold(f64::INFINITY, f64::min)
    };
    assert!(apart(&[], yielding) > 6.0, "{}", apart(&[], yielding));
    assert!(apart(&[("non_yielding", &[1.0])], yielding) < 5.0);
}

#[test]
fn people_are_let_cross_at_a_crosswalk_and_wait_elsewhere() {
    let manners = Manners { yielding: true, walking: true, lane_change: false };
    let waits = |states: &[AgentState]| states.iter().skip(20).any(|state| state.velocity_mps.length() < 0.2);
    // Both meet the car if nobody waits.
    let marked = drive(vec![car(20.0, 0.0, 8.0), walker(100.0, 8.5)], manners, &[]);
    let slowest = marked[0].iter().map(|s| s.velocity_mps.x).fold(f64::INFINITY, f64::min);
    assert!(slowest < 5.5, "the car went on at {slowest} m/s");
    let unmarked = drive(vec![car(20.0, 0.0, 8.0), walker(140.0, 12.5)], manners, &[]);
    assert!(waits(&unmarked[1]), "the walker did not wait");
    assert!(unmarked[0].iter().all(|s| s.velocity_mps.x > 6.0), "the car stopped for somebody off the crosswalk");
    let by_right = drive(vec![car(20.0, 0.0, 8.0), walker(140.0, 12.5)], manners, &[("missing_crosswalk", &[1.0])]);
    assert!(
        by_right[0].iter().any(|s| s.velocity_mps.x < 4.0),
        "the car did not stop at the crosswalk that the map lacks"
    );
}

#[test]
fn people_walk_at_their_own_pace() {
    let manners = Manners { walking: true, ..Manners::default() };
    let end = |factor: f64| {
        let states = drive(vec![walker(100.0, 3.0)], manners, &[("pedestrian_behaviour", &[factor, 0.0])]);
        states[0][100].pose.position.y
    };
    let (usual, fast) = (end(1.0), end(1.3));
    assert!((fast - usual - 0.3 * 14.0).abs() < 1.0, "{usual} and {fast}");
}

#[test]
fn the_road_differs_from_the_map_where_an_effect_says_so() {
    let tracks = || vec![car(0.0, 0.0, 8.0), car(0.0, 3.5, 8.0)];
    let moved = drive(tracks(), Manners::default(), &[("lane_offset", &[0.6])]);
    assert!(moved[0].iter().all(|state| (state.pose.position.y - 0.6).abs() < 1e-9));
    let beyond = drive(
        (0..6).map(|k| car(30.0 * f64::from(k), 0.0, 8.0)).collect(),
        Manners::default(),
        &[("missing_lane", &[1.0])],
    );
    let right = beyond.iter().filter(|agent| agent[0].pose.position.y < -3.0).count();
    assert!((1..6).contains(&right), "{right} of 6 use the lane that the map lacks");
}

#[test]
fn the_order_of_tracks_never_matters() {
    let states = |scene: ds_world::Scene| {
        let scene = shared(scene);
        let states = town::drive(&scene, &config(Manners::ALL, Vec::new()), None);
        let last = states.last().expect("states");
        let named =
            |agent: &AgentState| (scene.tracks[agent.id.0 as usize].name.clone(), (agent.pose, agent.velocity_mps));
        last.agents
            .iter()
            .map(|agent| {
                let (name, state) = named(agent);
                (name, format!("{state:?}"))
            })
            .collect::<BTreeMap<_, _>>()
    };
    let mut turned = town();
    turned.tracks.reverse();
    assert_eq!(states(town()), states(turned));
}

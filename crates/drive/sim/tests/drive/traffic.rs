//! How agents move: replayed, reacting, stopping at lights, on their path; contacts recorded.

use ds_sim::{IdmScope, SimConfig, Simulation};
use ds_space::{AgentId, PoseSe2, SimTime, Tick};
use ds_world::{AgentClass, AgentState, ContactKind, LightState, Scene, Trajectory, TrajectoryPoint};

use crate::street::{CAR, PERSON, add_light, crowded, expert, on_arc, scene, shared, track};

fn config(scope: Option<IdmScope>) -> SimConfig {
    SimConfig { agents: scope, ..SimConfig::default() }
}

/// A plan along the ego's own heading at a speed that falls to zero at a deceleration.
fn braking_plan(speed_mps: f64, deceleration_mps2: f64) -> Trajectory {
    let points = (1..=16)
        .map(|i| {
            let after_secs = f64::from(i) * 0.5;
            let secs = after_secs.min(speed_mps / deceleration_mps2);
            let x_m = speed_mps * secs - 0.5 * deceleration_mps2 * secs * secs;
            TrajectoryPoint { after: SimTime::from_secs(after_secs), pose: PoseSe2::new(x_m, 0.0, 0.0) }
        })
        .collect();
    Trajectory::new(points).expect("the plan is sound")
}

fn agent(simulation: &Simulation, id: u32) -> Option<AgentState> {
    simulation.state().agents.iter().find(|agent| agent.id == AgentId(id)).cloned()
}

/// Ego brakes to a stand before a car that was logged going on at 10 m/s, 15 m behind.
fn tailgated() -> Scene {
    let follower = track(AgentClass::Vehicle, CAR, 0.0, 0.0, |t| -15.0 + 10.0 * t);
    scene(0.0, expert(0.0, |t| 10.0 * t), vec![follower])
}

#[test]
fn a_follower_stops_behind_a_braking_ego_where_a_replayed_one_drives_into_it() {
    for (scope, collides) in [(None, true), (Some(IdmScope::BehindEgo), false), (Some(IdmScope::All), false)] {
        let mut simulation = Simulation::new(shared(tailgated()), config(scope), Tick(0)).expect("the scene is sound");
        simulation.begin_plan(&braking_plan(10.0, 5.0));
        let mut contacts = Vec::new();
        for _ in 0..100 {
            contacts.extend(simulation.step().contacts.clone());
        }
        assert_eq!(!contacts.is_empty(), collides, "{scope:?}");
        assert!(contacts.iter().take(1).all(|first| first.kind == ContactKind::Rear && !first.at_fault));
        if scope.is_some() {
            let behind = agent(&simulation, 0).expect("it is still there");
            assert!(behind.velocity_mps.length() < 0.2, "{scope:?}: still at {}", behind.velocity_mps);
            let gap_m = simulation.state().ego.pose.position.x - 0.832 - behind.pose.position.x - 2.25;
            assert!((0.5..4.0).contains(&gap_m), "{scope:?}: gap {gap_m} m");
        }
    }
}

#[test]
fn followers_keep_to_their_path() {
    let curvature_per_m = 0.02;
    let cars = (1..4).map(|i| {
        let start_m = -14.0 * f64::from(i);
        track(AgentClass::Vehicle, CAR, curvature_per_m, 0.0, move |t| start_m + 9.0 * t)
    });
    let scene = shared(scene(curvature_per_m, expert(curvature_per_m, |t| 9.0 * t), cars.collect()));
    let mut simulation = Simulation::new(scene, config(Some(IdmScope::All)), Tick(0)).expect("the scene is sound");
    simulation.begin_plan(&braking_plan(9.0, 0.8));
    for _ in 0..150 {
        for agent in &simulation.step().agents {
            let centre = on_arc(curvature_per_m, std::f64::consts::FRAC_PI_2 / curvature_per_m, 0.0).position;
            let radius_m = (agent.pose.position - (centre - ds_space::DVec2::new(50.0, 0.0))).length();
            assert!((radius_m - 50.0).abs() < 0.05, "agent {} is off its path by {} m", agent.id, radius_m - 50.0);
        }
    }
}

#[test]
fn red_lights_stop_followers_and_green_lets_them_go() {
    let car = track(AgentClass::Vehicle, CAR, 0.0, 0.0, |t| 30.0 + 10.0 * t);
    let mut street = scene(0.0, expert(0.0, |_| 0.0), vec![car]);
    let states = (0..201).map(|tick| if tick < 100 { LightState::Red } else { LightState::Green }).collect();
    add_light(&mut street, 80.0, states);
    let mut simulation = Simulation::new(shared(street), config(Some(IdmScope::All)), Tick(0)).expect("sound");
    simulation.begin_plan(&braking_plan(0.01, 0.1));
    for _ in 0..95 {
        simulation.step();
    }
    let nose_m = agent(&simulation, 0).expect("present").pose.position.x + 2.25;
    assert!((74.0..80.0).contains(&nose_m), "nose at {nose_m} m");
    for _ in 0..60 {
        simulation.step();
    }
    assert!(agent(&simulation, 0).expect("present").pose.position.x > 85.0);
}

#[test]
fn lights_people_and_standing_cars_are_as_logged() {
    let walker = track(AgentClass::Pedestrian, PERSON, 0.0, 6.0, |t| 1.3 * t);
    let parked = track(AgentClass::Vehicle, CAR, 0.0, -4.0, |_| -20.0);
    let mut street = scene(0.0, expert(0.0, |t| 5.0 * t), vec![walker, parked]);
    add_light(&mut street, 300.0, vec![LightState::Red, LightState::Yellow, LightState::Green]);
    let scene = shared(street);
    let mut simulation = Simulation::new(scene.clone(), config(Some(IdmScope::All)), Tick(0)).expect("sound");
    simulation.begin_plan(&braking_plan(5.0, 1.0));
    for tick in 1..150 {
        let state = simulation.step();
        assert_eq!(state.lights, [if tick == 1 { LightState::Yellow } else { LightState::Green }]);
        for (agent, track) in state.agents.iter().zip(&scene.tracks) {
            assert_eq!(Some(agent.pose), track.at(Tick(tick)).map(|point| point.pose), "tick {tick}");
        }
    }
}

#[test]
fn driving_into_a_standing_car_is_recorded_as_own_fault() {
    let parked = track(AgentClass::Vehicle, CAR, 0.0, 0.3, |_| 30.0);
    let scene = shared(scene(0.0, expert(0.0, |t| 10.0 * t), vec![parked]));
    let mut simulation = Simulation::new(scene, SimConfig::default(), Tick(0)).expect("the scene is sound");
    let first = (0..60).find_map(|_| simulation.step().contacts.first().copied()).expect("they meet");
    assert_eq!((first.kind, first.at_fault, first.agent), (ContactKind::Front, true, AgentId(0)));
    assert!((first.closing_speed_mps - 10.0).abs() < 0.1, "{}", first.closing_speed_mps);
}

#[test]
fn crowds_keep_order_and_do_not_collide_in_their_lanes() {
    let scene = shared(crowded(45));
    let mut simulation = Simulation::new(scene, config(Some(IdmScope::All)), Tick(0)).expect("the scene is sound");
    simulation.begin_plan(&braking_plan(8.0, 0.5));
    for tick in 0..150 {
        let state = simulation.step();
        assert!(state.agents.windows(2).all(|pair| pair[0].id < pair[1].id), "tick {tick}");
        let moving = |a: &&AgentState| a.class == AgentClass::Vehicle && a.pose.position.y > -2.0;
        let cars: Vec<&AgentState> = state.agents.iter().filter(moving).collect();
        for (i, a) in cars.iter().enumerate() {
            for b in &cars[i + 1..] {
                let same_lane = (a.pose.position.y - b.pose.position.y).abs() < 1.0;
                let apart_m = (a.pose.position.x - b.pose.position.x).abs();
                assert!(!same_lane || apart_m > 4.5, "tick {tick}: {} and {} are {apart_m} m apart", a.id, b.id);
            }
        }
    }
}

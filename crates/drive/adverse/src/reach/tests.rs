//! What is within the limits stays in the set, a wall too near empties it, and no drive of an expert is proven impossible.

use std::sync::Arc;

use ds_scenario::{Family, generate};
use ds_space::{Draws, PoseSe2};
use ds_vehicle::{Control, Rolling};
use ds_world::{AgentClass, Size, Track, TrackPoint};

use super::*;
use crate::solve::Trial;
use crate::{MotionModel, Options, variants};

const FROM: Tick = Tick(30);

/// Says whether a rear axle is in a cell whose speeds hold its own.
fn held(reach: &Reach<'_>, cells: &Cells, car: &Rolling) -> bool {
    let foot = reach.route.nearest(car.pose.position);
    let along = DVec2::from_angle(reach.route.heading_rad(foot.station_m));
    let velocity_mps = car.pose.forward() * car.speed_mps;
    let metric = 1.0 - reach.route.curvature_pm(foot.station_m) * foot.left_m;
    let station = DVec2::new(foot.station_m, velocity_mps.dot(along) / metric);
    let offset = DVec2::new(foot.left_m, along.perp_dot(velocity_mps));
    cells.values().any(|(stations, offsets)| stations.holds(station) && offsets.holds(offset))
}

/// A scene whose others are gone, but for a wall across the way so far ahead of the ego at [`FROM`], if one is asked for.
fn walled(ahead_m: Option<f64>) -> Scene {
    let mut scene = generate(Family::FreeCurve, 1000);
    let ticks = scene.ego_log.len();
    let way = crate::solve::logged_way(&scene).expect("the ego drives");
    let start_m = way.nearest(scene.logged_ego(FROM).pose.position).station_m;
    scene.tracks.clear();
    scene.tracks.extend(ahead_m.map(|ahead_m| {
        let on = way.pose(start_m + ahead_m);
        let pose = PoseSe2 { heading_rad: on.heading_rad + std::f64::consts::FRAC_PI_2, ..on };
        let point = TrackPoint { pose, z_m: 0.0, velocity_mps: DVec2::ZERO };
        let size = Size { length_m: 60.0, width_m: 2.0, height_m: 2.0 };
        Track { name: "wall".to_owned(), class: AgentClass::Vehicle, size, points: vec![Some(point); ticks] }
    }));
    scene
}

#[test]
fn a_car_within_the_limits_never_leaves_the_set() {
    let scene = walled(None);
    let road = Road::new(&scene.map);
    let reach = Reach::new(&scene, &road).expect("the ego drives");
    let cells = |steps: u32| reach.cells(FROM, FROM.plus(STEP_TICKS * steps)).expect("there is room to brake");
    let cells: Vec<Cells> = (1..=8).map(cells).collect();
    let ego = scene.logged_ego(FROM);
    let mut compared = 0;
    for seed in 0..200 {
        let draws = Draws::from_seed(seed, "drive");
        let mut car = Rolling { pose: ego.pose, speed_mps: ego.speed_mps() };
        for (i, cells) in (0u64..).zip(&cells) {
            let [push, pull] = [0, 1].map(|k| 2.0 * draws.uniform(10 * (i / 3) + k) - 1.0);
            // Together no more than 4 m/s², so that neither axis of the route gets more, however the car is turned.
            let acceleration_mps2 = (2.8 * push).max(-car.speed_mps / STEP_SECS);
            let curvature_pm = 2.8 * pull / car.speed_mps.max(3.0).powi(2);
            car = car.forwards(Control { acceleration_mps2, curvature_pm }, STEP_SECS);
            let vehicle = &scene.vehicle;
            let position = car.pose.position + car.pose.forward() * vehicle.rear_axle_to_centre_m;
            let centre = PoseSe2 { position, heading_rad: car.pose.heading_rad };
            if !road.holds(&vehicle.size.footprint(&centre).corners(), &centre) {
                break;
            }
            assert!(held(&reach, cells, &car), "drive {seed}, step {i}: {car:?}");
            compared += 1;
        }
    }
    assert!(compared > 800, "{compared}");
}

#[test]
fn a_wall_that_is_too_near_to_brake_empties_it_and_one_farther_away_does_not() {
    let speed_mps = walled(None).logged_ego(FROM).speed_mps();
    // From the rear axle to the front and half the wall; what braking at 7.6 m/s² needs beside it.
    let brakes_m = speed_mps * speed_mps / (2.0 * 7.6);
    for (ahead_m, proven) in [(5.2 + 0.1 * brakes_m, true), (8.0 + 1.5 * brakes_m, false)] {
        let scene = walled(Some(ahead_m));
        let road = Road::new(&scene.map);
        let reach = Reach::new(&scene, &road).expect("the ego drives");
        let emptied = reach.emptied(FROM, FROM.plus(40));
        assert_eq!(emptied.is_some(), proven, "{ahead_m} m at {speed_mps} m/s: {emptied:?}");
    }
}

#[test]
fn what_an_expert_solves_is_never_proven_unavoidable() {
    let options = Options { solve: false, ..Options::default() };
    let (mut proven, mut solved) = (0, 0);
    let scene = generate(Family::CutIn, 1000);
    for variant in variants(&scene, &MotionModel::town(), &options).expect("the ego drives").variants {
        let (threat, last) = (variant.measures.threat, variant.scene.last_tick());
        let name = variant.scene.name.clone();
        let scene = Arc::new(variant.scene);
        let road = Road::new(&scene.map);
        let drive = Trial { scene: &scene, road: &road, threat, last }.expert();
        assert!(drive.is_none() || variant.emptied.is_none(), "{name}: {:?}", variant.emptied);
        proven += u32::from(variant.emptied.is_some());
        solved += u32::from(drive.is_some());
    }
    assert!(solved >= 1, "{solved} solved, {proven} proven unavoidable");
}

#[test]
fn where_the_route_bends_sharply_nobody_is_faster_than_a_car() {
    // Without a bound on speeds these cells took gigabytes.
    let scene = generate(Family::UnprotectedLeft, 73_003);
    let road = Road::new(&scene.map);
    let reach = Reach::new(&scene, &road).expect("the ego drives");
    let from = Tick(40);
    let cells = reach.cells(from, from.plus(40)).expect("there is room to brake");
    assert!(cells.len() < 10_000, "{} cells", cells.len());
    let fastest_mps = reach.fastest_mps(from, 40);
    for (along, across) in cells.values() {
        assert!(along.speeds()[1] * reach.metric(along, across)[0] < fastest_mps + 1e-9);
    }
}

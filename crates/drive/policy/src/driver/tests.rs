//! The driver on a straight road: returns to the route, keeps behind others, stops at red.

use ds_space::{DVec3, SimTime};
use ds_world::{AgentClass, Map, Size, StopLine, Track, TrackPoint, TrafficLight};

use super::*;

const TICKS: u32 = 150;

/// A straight route along x, driven at 10 m/s.
pub(crate) fn scene(tracks: Vec<Track>, map: Map) -> Scene {
    let log = (0..TICKS).map(|tick| EgoState {
        pose: PoseSe2::new(f64::from(tick), 0.0, 0.0),
        velocity_mps: DVec2::new(10.0, 0.0),
        ..EgoState::default()
    });
    Scene {
        adversary: None,
        name: "straight".into(),
        family: String::new(),
        digest: Digest::default(),
        dt: SimTime::from_secs(0.1),
        map,
        vehicle: VehicleParameters::PACIFICA,
        ego_log: log.collect(),
        route: vec![DVec2::new(-20.0, 0.0), DVec2::new(300.0, 0.0)],
        tracks,
        cameras: vec![],
        prompt: String::new(),
        origin: ds_world::Origin::default(),
    }
}

fn track(at: impl Fn(u32) -> (PoseSe2, DVec2)) -> Track {
    let points = (0..TICKS).map(|tick| {
        let (pose, velocity_mps) = at(tick);
        Some(TrackPoint { pose, z_m: 0.0, velocity_mps })
    });
    let size = Size { length_m: 4.5, width_m: 1.9, height_m: 1.5 };
    Track { name: "other".into(), class: AgentClass::Vehicle, size, points: points.collect() }
}

fn ego(x_m: f64, y_m: f64, heading_rad: f64, speed_mps: f64) -> EgoState {
    EgoState {
        pose: PoseSe2::new(x_m, y_m, heading_rad),
        velocity_mps: DVec2::new(speed_mps, 0.0),
        ..EgoState::default()
    }
}

#[test]
fn returns_to_the_route_within_three_seconds() {
    let driver = Driver::new(&scene(vec![], Map::default()));
    for (left_m, heading_rad, speed_mps) in [(1.5, 0.0, 10.0), (-1.5, 0.25, 10.0), (0.5, -0.25, 6.0), (-1.0, 0.1, 14.0)]
    {
        let end = driver.drive(&ego(0.0, left_m, heading_rad, speed_mps), Tick(0), 30)[29];
        assert!(end.position.y.abs() < 0.3 && end.heading_rad.abs() < 0.08, "from {left_m} {heading_rad}: {end:?}");
        assert!(end.position.x > 20.0, "{end:?}");
    }
}

#[test]
fn stops_behind_a_standing_car_and_before_a_red_light() {
    let standing = track(|_| (PoseSe2::new(60.0, 0.3, 0.0), DVec2::ZERO));
    let aside = track(|_| (PoseSe2::new(60.0, 4.0, 0.0), DVec2::ZERO));
    let light = TrafficLight {
        position: DVec3::new(70.0, 0.0, 5.0),
        facing_rad: 0.0,
        lanes: vec![],
        states: vec![LightState::Red],
    };
    let line = StopLine { points: [DVec2::new(55.0, -2.0), DVec2::new(55.0, 2.0)], light: Some(0) };
    let red = Map { traffic_lights: vec![light], stop_lines: vec![line], ..Map::default() };
    let nose = VehicleParameters::PACIFICA.rear_axle_to_centre_m + 0.5 * VehicleParameters::PACIFICA.size.length_m;
    for (tracks, map, stops_before_m) in [
        (vec![standing], Map::default(), Some(57.75)),
        (vec![aside.clone()], red, Some(55.0)),
        (vec![aside], Map::default(), None),
    ] {
        let driver = Driver::new(&scene(tracks, map));
        let end = driver.drive(&ego(0.0, 0.0, 0.0, 10.0), Tick(0), 140)[139];
        match stops_before_m {
            Some(limit) => assert!((limit - 4.5..limit).contains(&(end.position.x + nose)), "{end:?}, limit {limit}"),
            None => assert!(end.position.x > 120.0, "{end:?}"),
        }
    }
}

#[test]
fn slows_for_one_who_will_cross_and_keeps_behind_one_who_drives() {
    let crossing = track(|tick| (PoseSe2::new(40.0, -20.0 + 0.5 * f64::from(tick), 1.57), DVec2::new(0.0, 5.0)));
    let slow = track(|tick| (PoseSe2::new(20.0 + 0.5 * f64::from(tick), 0.0, 0.0), DVec2::new(5.0, 0.0)));
    for other in [crossing, slow] {
        let poses = other.points.clone();
        let size = other.size;
        let driver = Driver::new(&scene(vec![other], Map::default()));
        let vehicle = VehicleParameters::PACIFICA;
        for (pose, point) in driver.drive(&ego(0.0, 0.0, 0.0, 10.0), Tick(0), 80).iter().zip(&poses[1..]) {
            let point = point.expect("the track has a point at every tick");
            let body = EgoState { pose: *pose, ..EgoState::default() }.centre(&vehicle);
            let apart = (body.position - point.pose.position).length();
            assert!(apart > 0.5 * (vehicle.size.length_m + size.width_m), "{apart} m apart at {pose:?}");
        }
    }
}

//! Sets the stage: a map, the expert and everyone else; lets them drive; turns the result into a scene.

use ds_space::plane::path::{Path, thin};
use ds_space::{CameraId, CameraModel, DVec2, DVec3, Digest, Intrinsics, PoseSe2, SimTime, angle};
use ds_world::{AgentClass, EgoState, Map, Origin, RoadEdge, Scene, Size, Track, TrackPoint, VehicleParameters};

use crate::family::dice::Dice;
use crate::family::roads::Roads;
use crate::family::traffic::{Driver, Hold, Manner, Motion, drive};

/// How many states a generated scenario has (15 s).
pub(crate) const TICKS: u32 = 151;
const DT_SECS: f64 = 0.1;

/// A scenario before anything has moved.
#[derive(Debug)]
pub(crate) struct Stage {
    pub roads: Roads,
    pub ego: Driver,
    pub others: Vec<Driver>,
    /// Walkers and standing objects, already moved.
    pub tracks: Vec<Track>,
    pub place: &'static str,
}

/// Where a vehicle starts and how fast.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Start {
    pub station_m: f64,
    pub speed_mps: f64,
}

/// Makes the expert's driver.
pub(crate) fn expert(path: Path, start: Start, wish_mps: f64, holds: Vec<Hold>) -> Driver {
    let vehicle = VehicleParameters::PACIFICA;
    Driver {
        class: AgentClass::Vehicle,
        size: vehicle.size,
        rear_axle_to_centre_m: vehicle.rear_axle_to_centre_m,
        path,
        station_m: start.station_m,
        speed_mps: start.speed_mps,
        wishes: vec![(0, wish_mps)],
        brake_mps2: 2.0,
        holds,
        manner: Manner::EXPERT,
    }
}

/// Draws the size of a car, van, truck or bus.
pub(crate) fn vehicle_size(dice: &mut Dice) -> Size {
    let (length_m, width_m, height_m) = match dice.whole(0, 19) {
        0..=12 => (dice.range(3.9, 4.9), dice.range(1.70, 1.92), dice.range(1.42, 1.75)),
        13..=16 => (dice.range(4.9, 5.9), dice.range(1.90, 2.05), dice.range(1.85, 2.4)),
        17..=18 => (dice.range(6.5, 8.5), dice.range(2.2, 2.4), dice.range(2.7, 3.3)),
        _ => (dice.range(10.5, 12.0), 2.5, dice.range(3.0, 3.3)),
    };
    Size { length_m, width_m, height_m }
}

/// Draws the size of an ordinary car.
pub(crate) fn car_size(dice: &mut Dice) -> Size {
    Size { length_m: dice.range(3.9, 4.9), width_m: dice.range(1.70, 1.92), height_m: dice.range(1.42, 1.75) }
}

/// Makes another vehicle on a path.
pub(crate) fn vehicle(path: Path, start: Start, wish_mps: f64, size: Size) -> Driver {
    Driver {
        class: AgentClass::Vehicle,
        size,
        rear_axle_to_centre_m: 0.28 * size.length_m,
        path,
        station_m: start.station_m,
        speed_mps: start.speed_mps,
        wishes: vec![(0, wish_mps)],
        brake_mps2: 2.5,
        holds: Vec::new(),
        manner: Manner::OTHERS,
    }
}

/// Places vehicles one behind another on a path between two stations.
pub(crate) fn stream(
    dice: &mut Dice,
    path: &Path,
    span_m: (f64, f64),
    gaps_m: (f64, f64),
    speed_mps: f64,
) -> Vec<Driver> {
    let mut drivers = Vec::new();
    let mut station_m = span_m.0 + dice.range(0.0, gaps_m.1);
    while station_m < span_m.1.min(path.length_m() - 20.0) {
        let speed = speed_mps * dice.range(0.92, 1.05);
        if dice.chance(0.06) {
            let size =
                Size { length_m: dice.range(1.7, 2.2), width_m: dice.range(0.6, 0.8), height_m: dice.range(1.6, 1.85) };
            let slow = dice.range(4.0, 6.5).min(speed);
            let mut rider = vehicle(path.clone(), Start { station_m, speed_mps: slow }, slow, size);
            rider.class = AgentClass::Cyclist;
            drivers.push(rider);
        } else {
            let size = vehicle_size(dice);
            drivers.push(vehicle(path.clone(), Start { station_m, speed_mps: speed }, speed, size));
        }
        station_m += 13.0 + dice.range(gaps_m.0, gaps_m.1);
    }
    drivers
}

/// Makes a person who stands at the start of a path until a time, walks along it, and stands at its end.
pub(crate) fn walker(dice: &mut Dice, path: &Path, start_secs: f64, speed_mps: f64) -> Track {
    let size =
        Size { length_m: dice.range(0.5, 0.75), width_m: dice.range(0.5, 0.75), height_m: dice.range(1.5, 1.92) };
    let end_m = path.length_m();
    let point = |tick: u32| {
        let walked_m = (f64::from(tick) * DT_SECS - start_secs) * speed_mps;
        let station_m = walked_m.clamp(0.0, end_m);
        let walks = walked_m > 0.0 && walked_m < end_m;
        let pose = path.pose(station_m);
        let velocity_mps = if walks { pose.forward() * speed_mps } else { DVec2::ZERO };
        Some(TrackPoint { pose, z_m: 0.0, velocity_mps })
    };
    Track { name: String::new(), class: AgentClass::Pedestrian, size, points: (0..TICKS).map(point).collect() }
}

/// Makes an object that stands still.
pub(crate) fn standing(class: AgentClass, pose: PoseSe2, size: Size) -> Track {
    let point = TrackPoint { pose, z_m: 0.0, velocity_mps: DVec2::ZERO };
    Track { name: String::new(), class, size, points: vec![Some(point); TICKS as usize] }
}

/// Places people who walk along the pavements near a place.
pub(crate) fn strollers(dice: &mut Dice, roads: &Roads, near: DVec2, count: u32) -> Vec<Track> {
    let mut tracks = Vec::new();
    for _ in 0..count {
        let pavement = &roads.pavements[dice.whole(0, u32::try_from(roads.pavements.len()).unwrap_or(1) - 1) as usize];
        let middle_m = pavement.nearest(near).station_m.clamp(0.0, pavement.length_m());
        let from_m = (middle_m + dice.range(-50.0, 60.0)).clamp(0.0, pavement.length_m());
        let speed = dice.range(0.8, 1.7);
        let to_m = (from_m + dice.sign() * speed * 16.0).clamp(0.0, pavement.length_m());
        let beside = dice.range(-0.6, 1.0);
        let ends = [from_m, 0.5 * (from_m + to_m), to_m];
        let points: Vec<DVec2> =
            ends.iter().map(|at| pavement.point(*at) + pavement.pose(*at).left() * beside).collect();
        if let (Some(path), true) = (Path::new(&points), (from_m - to_m).abs() > 3.0) {
            tracks.push(walker(dice, &path, 0.0, speed));
        }
    }
    tracks
}

/// Draws what the drive looks like.
fn prompt(dice: &mut Dice, place: &str) -> String {
    let light = dice.pick(&[
        "on a clear morning",
        "at noon",
        "on an overcast day",
        "in the late afternoon",
        "at dusk",
        "after rain",
    ]);
    let traffic = dice.pick(&["light traffic", "moderate traffic", "a quiet neighbourhood", "an urban street"]);
    format!("front camera view of {place}, {light}, {traffic}")
}

/// Lets everyone drive and returns the scene, placed by `world_from_stage`.
pub(crate) fn play(mut stage: Stage, dice: &mut Dice, world_from_stage: PoseSe2) -> Scene {
    let mut drivers = vec![stage.ego.clone()];
    drivers.append(&mut stage.others);
    let motions = drive(&drivers, &stage.tracks, &stage.roads.map.traffic_lights, TICKS);
    let mut tracks: Vec<Track> =
        drivers[1..].iter().zip(&motions[1..]).map(|(driver, motion)| driven(driver, motion)).collect();
    tracks.append(&mut stage.tracks);
    tracks.retain(|track| track.points.iter().any(Option::is_some));
    for (i, track) in tracks.iter_mut().enumerate() {
        let kind = match track.class {
            AgentClass::Vehicle => "vehicle",
            AgentClass::Pedestrian => "pedestrian",
            AgentClass::Cyclist => "cyclist",
            AgentClass::Cone => "cone",
            AgentClass::Barrier => "barrier",
        };
        track.name = format!("{kind}-{i}");
    }
    let intrinsics = Intrinsics::centred(160, 96, 70f64.to_radians());
    let id = CameraId::new("front").expect("a plain word is an id");
    let mut scene = Scene {
        adversary: None,
        name: String::new(),
        family: String::new(),
        digest: Digest::default(),
        dt: SimTime::from_secs(DT_SECS),
        map: stage.roads.map,
        vehicle: VehicleParameters::PACIFICA,
        ego_log: motions[0].iter().map(|motion| ego(&stage.ego.path, motion)).collect(),
        route: route(&stage.ego.path, &motions[0]),
        tracks,
        cameras: vec![CameraModel::mounted(id, intrinsics, DVec3::new(1.5, 0.0, 1.6), 0.0, 0.05)],
        prompt: prompt(dice, stage.place),
        origin: Origin::default(),
    };
    steer(&mut scene.ego_log, &scene.vehicle);
    place(&mut scene, &world_from_stage);
    scene
}

fn driven(driver: &Driver, motions: &[Motion]) -> Track {
    let point = |motion: &Motion| (!driver.is_gone(motion)).then(|| driver.point(motion));
    Track { name: String::new(), class: driver.class, size: driver.size, points: motions.iter().map(point).collect() }
}

fn ego(path: &Path, motion: &Motion) -> EgoState {
    let curvature = path.curvature_pm(motion.station_m);
    let speed = motion.speed_mps;
    EgoState {
        pose: path.pose(motion.station_m),
        velocity_mps: DVec2::new(speed, 0.0),
        yaw_rate_radps: speed * curvature,
        acceleration_mps2: DVec2::new(motion.acceleration_mps2, speed * speed * curvature),
        steering_rad: (VehicleParameters::PACIFICA.wheel_base_m * curvature).atan(),
        steering_rate_radps: 0.0,
    }
}

fn steer(log: &mut [EgoState], vehicle: &VehicleParameters) {
    for i in 0..log.len().saturating_sub(1) {
        let rate = (log[i + 1].steering_rad - log[i].steering_rad) / DT_SECS;
        log[i].steering_rate_radps = rate.clamp(-vehicle.max_steering_rate_radps, vehicle.max_steering_rate_radps);
    }
}

/// Returns the path to drive, from 20 m behind the start to 60 m past the end of the log where the path goes on.
fn route(path: &Path, motions: &[Motion]) -> Vec<DVec2> {
    let from_m = (motions[0].station_m - 20.0).max(0.0);
    let to_m = (motions[motions.len() - 1].station_m + 60.0).min(path.length_m());
    let count = ((to_m - from_m) / 0.5).ceil() as usize;
    let points: Vec<DVec2> =
        (0..=count).map(|i| path.point(from_m + (to_m - from_m) * i as f64 / count as f64)).collect();
    thin(&points, 0.01, 5.0)
}

/// Moves a whole scene rigidly.
fn place(scene: &mut Scene, world_from_stage: &PoseSe2) {
    let shift =
        |points: &mut Vec<DVec2>| points.iter_mut().for_each(|point| *point = world_from_stage.to_outer(*point));
    let Map {
        lanes,
        junctions,
        drivable,
        road_edges,
        line_markings,
        crosswalks,
        stop_lines,
        traffic_lights,
        structures,
    } = &mut scene.map;
    for lane in lanes {
        shift(&mut lane.centre_line);
        shift(&mut lane.polygon);
    }
    junctions.iter_mut().chain(drivable).for_each(shift);
    road_edges.iter_mut().map(|edge: &mut RoadEdge| &mut edge.points).for_each(shift);
    line_markings.iter_mut().map(|line| &mut line.points).for_each(shift);
    crosswalks.iter_mut().map(|crosswalk| &mut crosswalk.polygon).for_each(shift);
    for stop in stop_lines {
        stop.points = stop.points.map(|point| world_from_stage.to_outer(point));
    }
    structures.iter_mut().map(|structure| &mut structure.outline).for_each(shift);
    for light in traffic_lights {
        light.position = world_from_stage.to_outer(light.position.truncate()).extend(light.position.z);
        light.facing_rad = angle::wrap(light.facing_rad + world_from_stage.heading_rad);
    }
    shift(&mut scene.route);
    for state in &mut scene.ego_log {
        state.pose = world_from_stage.compose(&state.pose);
    }
    for point in scene.tracks.iter_mut().flat_map(|track| track.points.iter_mut().flatten()) {
        point.pose = world_from_stage.compose(&point.pose);
        point.velocity_mps = DVec2::from_angle(world_from_stage.heading_rad).rotate(point.velocity_mps);
    }
}

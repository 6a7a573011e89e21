//! The families that need one road only: a free curve, a braking lead, a cut-in, a pedestrian crossing, parked cars.

use ds_space::plane::path::Path;
use ds_space::{DVec2, PoseSe2};
use ds_world::{AgentClass, Crosswalk, Size, StopLine};

use crate::family::dice::Dice;
use crate::family::roads::{Road, Roads, Section, line};
use crate::family::stage::{
    Stage, Start, car_size, expert, standing, stream, strollers, vehicle, vehicle_size, walker,
};
use crate::family::traffic::{Hold, Until};

/// Metres of road behind the place where the expert starts.
const BEHIND_M: f64 = 60.0;

/// Draws a road of gentle bends, long enough for 15 s.
fn street(dice: &mut Dice, section: Section, bend_pm: f64) -> (Roads, Road) {
    let mut pieces = vec![(BEHIND_M + dice.range(10.0, 40.0), 0.0)];
    let mut length_m = pieces[0].0;
    let mut sign = dice.sign();
    while length_m < 390.0 {
        let piece = (dice.range(35.0, 80.0), sign * dice.range(0.3, 1.0) * bend_pm);
        let straight = (dice.range(10.0, 50.0), 0.0);
        length_m += piece.0 + straight.0;
        pieces.extend([piece, straight]);
        sign = if dice.chance(0.7) { -sign } else { sign };
    }
    let mut roads = Roads::default();
    let road = roads.road("main", &line(&pieces, BEHIND_M), section);
    (roads, road)
}

fn section(dice: &mut Dice, forward: (u32, u32), backward: (u32, u32), limit_mps: f64) -> Section {
    Section {
        forward: dice.whole(forward.0, forward.1) as usize,
        backward: dice.whole(backward.0, backward.1) as usize,
        lane_width_m: dice.range(3.2, 3.8),
        shoulder_m: dice.range(0.4, 1.5),
        speed_limit_mps: limit_mps,
    }
}

/// Adds oncoming traffic to all backward lanes.
fn oncoming(dice: &mut Dice, roads: &Roads, road: &Road, speed_mps: f64) -> Vec<crate::family::traffic::Driver> {
    let mut drivers = Vec::new();
    for lane in &road.backward {
        let gaps = if dice.chance(0.5) { (10.0, 45.0) } else { (30.0, 110.0) };
        drivers.extend(stream(dice, &roads.route(&[*lane]), (5.0, 380.0), gaps, speed_mps));
    }
    drivers
}

/// A free road with bends.
pub(crate) fn free_curve(dice: &mut Dice) -> Stage {
    let limit = dice.range(9.0, 15.5);
    let section = section(dice, (1, 2), (1, 2), limit);
    let radius_m = dice.range(28.0, 110.0);
    let (roads, road) = street(dice, section, 1.0 / radius_m);
    let lane = road.forward[dice.whole(0, u32::try_from(section.forward).unwrap_or(1) - 1) as usize];
    let mut others = oncoming(dice, &roads, &road, limit);
    for beside in road.forward.iter().filter(|other| **other != lane) {
        others.extend(stream(dice, &roads.route(&[*beside]), (20.0, 300.0), (20.0, 70.0), limit * 0.95));
    }
    if dice.chance(0.4) {
        let start = Start { station_m: BEHIND_M + dice.range(45.0, 80.0), speed_mps: limit };
        others.push(vehicle(roads.route(&[lane]), start, limit, vehicle_size(dice)));
    }
    let wish = limit * dice.range(0.9, 1.0);
    let ego = expert(
        roads.route(&[lane]),
        Start { station_m: BEHIND_M, speed_mps: wish * dice.range(0.75, 0.97) },
        wish,
        vec![],
    );
    let count = dice.whole(0, 5);
    let tracks = strollers(dice, &roads, DVec2::new(60.0, 0.0), count);
    Stage { roads, ego, others, tracks, place: "a winding road with bends" }
}

/// A lead vehicle that brakes, perhaps to a halt, and goes on.
pub(crate) fn lead_braking(dice: &mut Dice) -> Stage {
    let limit = dice.range(9.0, 14.5);
    let section = section(dice, (1, 2), (1, 2), limit);
    let radius_m = dice.range(90.0, 400.0);
    let (roads, road) = street(dice, section, 1.0 / radius_m);
    let lane = road.forward[0];
    let path = roads.route(&[lane]);
    let speed = limit * dice.range(0.85, 0.95);
    let gap_m = 4.0 + speed * dice.range(1.7, 2.6);
    let size = vehicle_size(dice);
    let start = Start { station_m: BEHIND_M + 4.1 + gap_m + 0.22 * size.length_m, speed_mps: speed };
    let mut lead = vehicle(path.clone(), start, speed, size);
    lead.brake_mps2 = dice.range(2.2, 4.5);
    let brake = dice.whole(10, 50);
    let slow = if dice.chance(0.55) { 0.0 } else { dice.range(1.5, 4.5) };
    lead.wishes.extend([(brake, slow), (brake + dice.whole(35, 60), limit)]);
    let mut others = vec![lead];
    for beside in &road.forward[1..] {
        others.extend(stream(dice, &roads.route(&[*beside]), (10.0, 300.0), (15.0, 60.0), limit));
    }
    others.extend(oncoming(dice, &roads, &road, limit));
    let ego = expert(path, Start { station_m: BEHIND_M, speed_mps: speed }, limit, vec![]);
    let count = dice.whole(0, 4);
    let tracks = strollers(dice, &roads, DVec2::new(60.0, 0.0), count);
    Stage { roads, ego, others, tracks, place: "a street behind a vehicle that brakes" }
}

/// Returns a path that goes over from one path to another between two stations.
fn change(from: &Path, to: &Path, start_m: f64, length_m: f64) -> Path {
    let points: Vec<DVec2> = (0..=(from.length_m() as usize))
        .map(|i| {
            let station = i as f64;
            let share = ((station - start_m) / length_m).clamp(0.0, 1.0);
            let blend = share * share * share * (10.0 - share * (15.0 - 6.0 * share));
            let point = from.point(station);
            let target = to.nearest(point).station_m;
            point.lerp(to.point(target), blend)
        })
        .collect();
    Path::new(&points).expect("a lane is longer than a metre").even(0.5)
}

/// A vehicle from the next lane that moves in close ahead.
pub(crate) fn cut_in(dice: &mut Dice) -> Stage {
    let limit = dice.range(9.5, 15.0);
    let section = section(dice, (2, 3), (1, 2), limit);
    let radius_m = dice.range(110.0, 500.0);
    let (roads, road) = street(dice, section, 1.0 / radius_m);
    let mine = dice.whole(0, u32::try_from(section.forward).unwrap_or(2) - 1) as usize;
    let from = if mine == 0 { 1 } else { mine - 1 };
    let (my_path, from_path) = (roads.route(&[road.forward[mine]]), roads.route(&[road.forward[from]]));
    let speed = limit * dice.range(0.8, 0.92);
    let size = vehicle_size(dice);
    let ahead_m = dice.range(7.0, 16.0) + 0.5 * size.length_m;
    let pace = speed * dice.range(0.98, 1.12);
    let begin_m = BEHIND_M + ahead_m + pace * dice.range(1.0, 3.5);
    let changed = change(&from_path, &my_path, begin_m, pace * dice.range(2.2, 3.6));
    let mut cutter = vehicle(changed, Start { station_m: BEHIND_M + ahead_m, speed_mps: pace }, pace, size);
    cutter.wishes.push((dice.whole(40, 70), speed * dice.range(0.55, 0.95)));
    let mut others = vec![cutter];
    for (i, lane) in road.forward.iter().enumerate() {
        let path = roads.route(&[*lane]);
        let first = if i == mine { BEHIND_M + ahead_m + 75.0 } else { BEHIND_M + ahead_m + 45.0 };
        others.extend(stream(dice, &path, (first, first + 120.0), (15.0, 60.0), limit));
        if i != mine && dice.chance(0.5) {
            others.push(vehicle(
                path,
                Start { station_m: dice.range(15.0, 30.0), speed_mps: speed },
                speed,
                car_size(dice),
            ));
        }
    }
    others.extend(oncoming(dice, &roads, &road, limit));
    let ego = expert(my_path, Start { station_m: BEHIND_M, speed_mps: speed }, limit, vec![]);
    Stage { roads, ego, others, tracks: vec![], place: "a multi-lane road where a vehicle cuts in" }
}

/// People on a crosswalk in mid-block; the expert halts for them.
pub(crate) fn pedestrian_crossing(dice: &mut Dice) -> Stage {
    let limit = dice.range(8.0, 12.5);
    let section = section(dice, (1, 2), (1, 2), limit);
    let radius_m = dice.range(100.0, 600.0);
    let (mut roads, road) = street(dice, section, 1.0 / radius_m);
    let at_m = BEHIND_M + dice.range(38.0, 65.0);
    let reference = road.reference.clone();
    let (left_m, right_m) = (section.left_m() + section.shoulder_m, section.right_m() + section.shoulder_m);
    let half_m = dice.range(1.4, 2.2);
    let corner = |station: f64, left: f64| reference.pose(station).to_outer(DVec2::new(0.0, left));
    let polygon = [(-half_m, left_m), (-half_m, -right_m), (half_m, -right_m), (half_m, left_m)];
    roads.map.crosswalks.push(Crosswalk { polygon: polygon.map(|(along, left)| corner(at_m + along, left)).to_vec() });
    let stop_m = at_m - half_m - 1.2;
    let lines = [(stop_m, 0.0, -section.right_m()), (at_m + half_m + 1.2, section.left_m(), 0.0)];
    for (station, a, b) in lines {
        roads.map.stop_lines.push(StopLine { points: [corner(station, a), corner(station, b)], light: None });
    }
    let mut tracks = Vec::new();
    let mut clear_secs: f64 = 0.0;
    for _ in 0..dice.whole(1, 4) {
        let (begin, end) =
            if dice.chance(0.5) { (left_m + 1.2, -right_m - 1.2) } else { (-right_m - 1.2, left_m + 1.2) };
        let along = at_m + dice.range(-half_m + 0.4, half_m - 0.4);
        let path = Path::new(&[corner(along, begin), corner(along, end)]).expect("a road is wider than a metre");
        let (start, speed) = (dice.range(0.0, 3.5), dice.range(1.0, 1.7));
        clear_secs = clear_secs.max(start + path.length_m() / speed);
        tracks.push(walker(dice, &path, start, speed));
    }
    let count = dice.whole(1, 5);
    tracks.extend(strollers(dice, &roads, reference.point(at_m), count));
    let release = (clear_secs * 10.0).round() as u32;
    let mut others = Vec::new();
    for (i, lane) in road.forward.iter().chain(&road.backward).enumerate() {
        let path = roads.route(&[*lane]);
        let crossing = path.nearest(reference.point(at_m)).station_m;
        let first = if i == 0 { crossing + 30.0 } else { 5.0 };
        let hold = Hold { at_m: crossing - half_m - 1.5, until: Until::Tick(release) };
        for mut driver in stream(dice, &path, (first, first + 220.0), (18.0, 80.0), limit) {
            let near = driver.station_m > crossing - 45.0 && driver.station_m < crossing + 14.0;
            if !near && (i != 0 || driver.station_m > crossing) {
                driver.holds.push(hold.clone());
                others.push(driver);
            }
        }
    }
    let path = roads.route(&[road.forward[0]]);
    let stop = path.nearest(corner(stop_m, -0.5 * section.lane_width_m)).station_m;
    let speed = limit * dice.range(0.75, 0.9);
    let holds = vec![Hold { at_m: stop - 0.5, until: Until::Tick(release) }];
    let ego = expert(path, Start { station_m: BEHIND_M, speed_mps: speed }, limit, holds);
    Stage { roads, ego, others, tracks, place: "a street with people on a pedestrian crossing" }
}

/// Cars parked on the right that force the expert towards the middle, after oncoming traffic has passed.
pub(crate) fn parked_narrowing(dice: &mut Dice) -> Stage {
    let limit = dice.range(7.0, 10.5);
    let mut section = section(dice, (1, 1), (1, 1), limit);
    section.lane_width_m = dice.range(3.3, 3.9);
    let radius_m = dice.range(120.0, 600.0);
    let (roads, road) = street(dice, section, 1.0 / radius_m);
    let lane = roads.path(road.forward[0]).clone();
    let begin_m = BEHIND_M + dice.range(36.0, 60.0);
    let mut station = begin_m;
    let mut tracks = Vec::new();
    let mut inside_m: f64 = 0.0;
    for _ in 0..dice.whole(1, 4) {
        let size = car_size(dice);
        let into_m = dice.range(0.7, 1.9);
        let right = -0.5 * section.lane_width_m + into_m - 0.5 * size.width_m;
        let mut pose = lane.pose(station + 0.5 * size.length_m);
        pose.position = pose.to_outer(DVec2::new(0.0, right));
        pose.heading_rad = ds_space::angle::wrap(pose.heading_rad + dice.range(-0.03, 0.03));
        tracks.push(standing(AgentClass::Vehicle, pose, size));
        inside_m = inside_m.max(into_m + 0.08);
        station += size.length_m + dice.range(0.8, 3.0);
    }
    if dice.chance(0.4) {
        let size = Size { length_m: 0.4, width_m: 0.4, height_m: 0.75 };
        for k in 0..3 {
            let at = PoseSe2 { ..lane.pose(begin_m - 3.0 - 2.5 * f64::from(k)) };
            let right = -0.5 * section.lane_width_m + 0.35 * f64::from(2 - k) - 0.1;
            let pose = PoseSe2 { position: at.to_outer(DVec2::new(0.0, right)), ..at };
            tracks.push(standing(AgentClass::Cone, pose, size));
        }
    }
    let clearance = dice.range(0.75, 1.0);
    let shift_m = (inside_m - 0.5 * section.lane_width_m + clearance + 1.15).max(0.0);
    let blend_m = dice.range(17.0, 24.0);
    let shifted: Vec<DVec2> = (0..(lane.length_m() as usize))
        .map(|i| {
            let at = i as f64;
            let rise = |x: f64| {
                let x = x.clamp(0.0, 1.0);
                x * x * x * (10.0 - x * (15.0 - 6.0 * x))
            };
            let share = rise((at - begin_m + blend_m + 5.5) / blend_m) - rise((at - station - 1.0) / blend_m);
            lane.pose(at).to_outer(DVec2::new(0.0, shift_m * share))
        })
        .collect();
    let path = Path::new(&shifted).expect("a lane is longer than a metre").smooth(2.5);
    let meeting_path = roads.route(&[road.backward[0]]);
    let place = meeting_path.point(meeting_path.nearest(lane.point(begin_m)).station_m);
    let mut others = Vec::new();
    let count = dice.whole(1, 3);
    let passing = meeting_path.nearest(lane.point(BEHIND_M)).station_m;
    let mut back_m = passing - dice.range(55.0, 105.0);
    for _ in 0..count {
        let start = Start { station_m: back_m, speed_mps: limit * 0.9 };
        others.push(vehicle(meeting_path.clone(), start, limit * 0.9, car_size(dice)));
        back_m -= dice.range(14.0, 22.0);
    }
    if dice.chance(0.6) {
        others.push(vehicle(
            meeting_path.clone(),
            Start { station_m: back_m - 120.0, speed_mps: limit * 0.9 },
            limit,
            vehicle_size(dice),
        ));
    }
    others.retain(|driver| driver.station_m > 2.0);
    let secs = (station - begin_m + 2.0 * blend_m) / (0.6 * limit) + 1.5;
    let stop = path.nearest(lane.point(begin_m - blend_m)).station_m;
    let holds = vec![Hold { at_m: stop, until: Until::Gap(place, secs) }];
    let speed = limit * dice.range(0.75, 0.95);
    let ego = expert(path, Start { station_m: BEHIND_M, speed_mps: speed }, limit * 0.9, holds);
    let people = dice.whole(1, 6);
    tracks.extend(strollers(dice, &roads, DVec2::new(50.0, 0.0), people));
    Stage { roads, ego, others, tracks, place: "a narrow street with parked cars" }
}

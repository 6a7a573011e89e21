//! The families at junctions: crossing traffic with lights, an unprotected left turn, a roundabout.

use ds_space::DVec2;
use ds_space::plane::path::Path;
use ds_world::LightState;

use crate::family::dice::Dice;
use crate::family::junction::{Junction, JunctionDesign, Roundabout, junction, roundabout};
use crate::family::roads::Section;
use crate::family::stage::{Stage, Start, expert, strollers, vehicle, vehicle_size};
use crate::family::traffic::{Driver, Hold, Until};

fn section(dice: &mut Dice, lanes: usize, limit_mps: f64) -> Section {
    Section {
        forward: lanes,
        backward: lanes,
        lane_width_m: dice.range(3.2, 3.7),
        shoulder_m: dice.range(0.3, 1.0),
        speed_limit_mps: limit_mps,
    }
}

/// A two-phase cycle: arms 0 and 2 against arms 1 and 3.
#[derive(Debug, Clone, Copy)]
struct Cycle {
    /// Ticks by which the cycle is already under way at tick 0; 0 is the start of green for arms 0 and 2.
    offset: u32,
    green: u32,
    cross_green: u32,
}

const YELLOW: u32 = 30;
const ALL_RED: u32 = 12;

impl Cycle {
    fn shows(&self, arm: usize, tick: u32) -> LightState {
        let cross_start = self.green + YELLOW + ALL_RED;
        let length = cross_start + self.cross_green + YELLOW + ALL_RED;
        let at = (tick + self.offset) % length;
        let (from, green) = if arm.is_multiple_of(2) { (0, self.green) } else { (cross_start, self.cross_green) };
        if at >= from && at < from + green {
            LightState::Green
        } else if at >= from + green && at < from + green + YELLOW {
            LightState::Yellow
        } else {
            LightState::Red
        }
    }
}

/// Adds vehicles that come in on an arm and go a way each.
fn arriving(
    dice: &mut Dice,
    crossing: &Junction,
    from: usize,
    ways: &[(usize, usize)],
    span_m: (f64, f64),
) -> Vec<Driver> {
    let mut drivers: Vec<Driver> = Vec::new();
    let lanes = crossing.arms[from].as_ref().map_or(0, |arm| arm.backward.len());
    for lane in 0..lanes {
        let fitting: Vec<(usize, usize)> = ways.iter().copied().filter(|way| way.1 == lane).collect();
        if fitting.is_empty() {
            continue;
        }
        let limit = crossing.arms[from].as_ref().map_or(10.0, |arm| arm.section.speed_limit_mps);
        let mut station_m = crossing.stop_station_m(from, lane) - 8.0 - span_m.0 - dice.range(0.0, 18.0);
        while station_m > (crossing.stop_station_m(from, lane) - span_m.1).max(3.0) {
            let way = fitting[dice.whole(0, u32::try_from(fitting.len()).unwrap_or(1) - 1) as usize];
            if let Some(lanes) = crossing.way(from, way.0, lane) {
                let path = crossing.roads.route(&lanes);
                let speed = limit * dice.range(0.85, 0.98);
                drivers.push(vehicle(path, Start { station_m, speed_mps: speed }, speed, vehicle_size(dice)));
            }
            station_m -= 15.0 + dice.range(5.0, 40.0);
        }
    }
    drivers
}

/// Returns where two paths cross, as a station on the first.
fn meeting(mine: &Path, other: &Path) -> Option<DVec2> {
    let stations = (0..mine.length_m() as usize).map(|i| i as f64);
    let close = |station: &f64| other.nearest(mine.point(*station)).left_m.abs() < 0.6;
    stations.filter(close).map(|station| mine.point(station)).next()
}

/// A junction with lights; traffic crosses while the expert waits, or waits while it crosses.
pub(crate) fn signalised_crossing(dice: &mut Dice) -> Stage {
    let limit = dice.range(8.0, 12.5);
    let lanes = dice.whole(1, 2) as usize;
    let section = section(dice, lanes, limit);
    let mouth_m = section.right_m() + section.shoulder_m + dice.range(6.0, 10.0);
    let mut crossing = junction(dice, &JunctionDesign { section, mouth_m, present: [true; 4], crosswalks: true });
    let cycle = {
        let (green, cross_green) = (dice.whole(80, 140), dice.whole(50, 90));
        let cross_start = green + YELLOW + ALL_RED;
        // Mostly red on arrival, green a few seconds later; else green with some time left.
        let before_green = dice.whole(25, 80);
        let offset = if dice.chance(0.75) {
            cross_start + cross_green + YELLOW + ALL_RED - before_green
        } else {
            dice.whole(0, 30)
        };
        Cycle { offset, green, cross_green }
    };
    crossing.signal(|arm, tick| cycle.shows(arm, tick));
    let lane = dice.whole(0, u32::try_from(lanes).unwrap_or(1) - 1) as usize;
    let to = if lane + 1 == lanes && dice.chance(0.25) { 1 } else { 2 };
    let way = crossing.way(0, to, lane).expect("arm 0 leads straight on and to the right");
    let path = crossing.roads.route(&way);
    let stop_m = crossing.stop_station_m(0, lane);
    let start_m = stop_m - dice.range(32.0, 62.0);
    let speed = limit * dice.range(0.7, 0.9);
    let mut others = Vec::new();
    for from in 0..4usize {
        let straight: Vec<(usize, usize)> = (0..lanes).map(|lane| ((from + 2) % 4, lane)).collect();
        let mut ways = straight;
        ways.push(((from + 1) % 4, lanes - 1));
        let span = if from == 0 { (0.0, 140.0) } else { (dice.range(0.0, 12.0), 130.0) };
        for mut driver in arriving(dice, &crossing, from, &ways, span) {
            let in_my_lane = from == 0 && driver.path.nearest(path.point(start_m)).left_m.abs() < 1.5;
            let gap_m = (driver.station_m - start_m).abs();
            if in_my_lane && (gap_m < 16.0 || (driver.station_m < start_m && gap_m < 24.0)) {
                continue;
            }
            let lane = usize::from(
                lanes == 2
                    && driver
                        .path
                        .nearest(
                            crossing
                                .roads
                                .path(crossing.arms[from].as_ref().expect("all arms exist").backward[0])
                                .point(30.0),
                        )
                        .left_m
                        .abs()
                        > 1.5,
            );
            driver.holds.push(Hold { at_m: crossing.stop_station_m(from, lane), until: Until::Green(from) });
            if driver.station_m > driver.holds[0].at_m - 30.0 && cycle.shows(from, 0) != LightState::Green {
                driver.speed_mps *= ((driver.holds[0].at_m - driver.station_m - 6.0) / 30.0).clamp(0.0, 1.0);
            }
            others.push(driver);
        }
    }
    let holds = vec![Hold { at_m: stop_m - 0.6, until: Until::Green(0) }];
    let ego = expert(path, Start { station_m: start_m, speed_mps: speed }, limit * 0.95, holds);
    let people = dice.whole(1, 6);
    let tracks = strollers(dice, &crossing.roads, DVec2::ZERO, people);
    Stage { roads: crossing.roads, ego, others, tracks, place: "a junction with traffic lights and crossing traffic" }
}

/// A left turn through oncoming traffic that has priority.
pub(crate) fn unprotected_left(dice: &mut Dice) -> Stage {
    let limit = dice.range(8.0, 12.0);
    let lanes = dice.whole(1, 2) as usize;
    let section = section(dice, lanes, limit);
    let mouth_m = section.right_m() + section.shoulder_m + dice.range(6.0, 9.0);
    let has_side = dice.chance(0.5);
    let crosswalks = dice.chance(0.5);
    let crossing =
        junction(dice, &JunctionDesign { section, mouth_m, present: [true, has_side, true, true], crosswalks });
    let way = crossing.way(0, 3, 0).expect("arm 0 leads to the left");
    let path = crossing.roads.route(&way);
    let stop_m = crossing.stop_station_m(0, 0);
    let start_m = stop_m - dice.range(22.0, 48.0);
    let speed = limit * dice.range(0.6, 0.85);
    let ways: Vec<(usize, usize)> = (0..lanes).map(|lane| (0, lane)).collect();
    let near_m = dice.range(0.0, 15.0);
    let far_m = near_m + dice.range(30.0, 75.0);
    let mut others = arriving(dice, &crossing, 2, &ways, (near_m, far_m));
    if dice.chance(0.7) {
        others.extend(arriving(dice, &crossing, 2, &ways[..1], (140.0, 165.0)));
    }
    for side in [1usize, 3] {
        if crossing.arms[side].is_some() {
            for mut driver in arriving(dice, &crossing, side, &[((side + 1) % 4, lanes - 1)], (0.0, 60.0)) {
                driver.holds.push(Hold { at_m: crossing.stop_station_m(side, lanes - 1), until: Until::Tick(400) });
                driver.speed_mps *= 0.3;
                others.push(driver);
            }
        }
    }
    for mut driver in arriving(dice, &crossing, 0, &[(2, 0)], (0.0, 165.0)) {
        let gap_m = start_m - driver.station_m;
        if gap_m > 22.0 {
            driver.speed_mps *= 0.9;
            others.push(driver);
        }
    }
    let mut places: Vec<DVec2> = Vec::new();
    for lane in 0..lanes {
        let opposing = crossing.way(2, 0, lane).map(|way| crossing.roads.route(&way));
        places.extend(opposing.and_then(|opposing| meeting(&path, &opposing)));
    }
    let secs = dice.range(3.8, 4.8);
    let wait_m = path.nearest(crossing.roads.path(way[1]).point(0.0)).station_m + dice.range(0.0, 3.0);
    let holds = places.iter().map(|place| Hold { at_m: wait_m, until: Until::Gap(*place, secs) }).collect();
    let ego = expert(path, Start { station_m: start_m, speed_mps: speed }, limit * 0.9, holds);
    let people = dice.whole(0, 5);
    let tracks = strollers(dice, &crossing.roads, DVec2::ZERO, people);
    Stage { roads: crossing.roads, ego, others, tracks, place: "a left turn through oncoming traffic" }
}

/// Returns the lanes from an arm around a roundabout to another.
fn around(circle: &Roundabout, from: usize, steps: usize) -> Vec<ds_world::LaneId> {
    let mut lanes = vec![circle.arms[from].backward[0], circle.entries[from]];
    let first = 2 * from + 1;
    lanes.extend((0..2 * steps - 1).map(|k| circle.ring[(first + k) % 8]));
    lanes.push(circle.exits[(from + steps) % 4]);
    lanes.push(circle.arms[(from + steps) % 4].forward[0]);
    lanes
}

/// A roundabout where the expert yields to the ring.
pub(crate) fn roundabout_family(dice: &mut Dice) -> Stage {
    let limit = dice.range(8.0, 11.5);
    let section = section(dice, 1, limit);
    let radius_m = dice.range(14.0, 20.0);
    let plan =
        JunctionDesign { section, mouth_m: radius_m + dice.range(15.0, 18.0), present: [true; 4], crosswalks: false };
    let circle = roundabout(dice, &plan, radius_m, dice_width(section));
    let hold = |from: usize, secs: f64| {
        let lane = circle.roads.path(circle.arms[from].backward[0]);
        let entry = circle.roads.path(circle.entries[from]);
        let stop_m = lane.length_m() - circle.stop_m + 1.5;
        let near = entry.point(entry.length_m() - 2.0);
        [
            Hold { at_m: stop_m, until: Until::Gap(near, secs) },
            Hold { at_m: stop_m, until: Until::Gap(circle.merges[from], secs) },
        ]
    };
    let steps = dice.whole(1, 3) as usize;
    let path = circle.roads.route(&around(&circle, 0, steps));
    let stop_m = circle.roads.path(circle.arms[0].backward[0]).length_m();
    let start_m = stop_m - dice.range(22.0, 45.0);
    let mut others: Vec<Driver> = Vec::new();
    for k in 0..4usize {
        if dice.chance(0.5) {
            let mut lanes = vec![circle.ring[2 * k], circle.ring[2 * k + 1]];
            for j in 2..dice.whole(2, 4) as usize * 2 {
                lanes.push(circle.ring[(2 * k + j) % 8]);
            }
            let out = (k + lanes.len() / 2) % 4;
            lanes.extend([circle.exits[out], circle.arms[out].forward[0]]);
            let ring_speed = dice.range(4.5, 6.0);
            let start = Start { station_m: dice.range(2.0, 6.0), speed_mps: ring_speed };
            others.push(vehicle(circle.roads.route(&lanes), start, limit, vehicle_size(dice)));
        }
    }
    for from in 1..4usize {
        let mut station_m = stop_m - dice.range(12.0, 45.0);
        for _ in 0..dice.whole(0, 2) {
            let lanes = around(&circle, from, dice.whole(1, 3) as usize);
            let speed = limit * 0.75;
            let mut driver =
                vehicle(circle.roads.route(&lanes), Start { station_m, speed_mps: speed }, limit, vehicle_size(dice));
            driver.holds.extend(hold(from, 3.6));
            others.push(driver);
            station_m -= dice.range(22.0, 40.0);
        }
    }
    if dice.chance(0.4) {
        let lanes = around(&circle, 0, dice.whole(1, 3) as usize);
        let start = Start { station_m: start_m - dice.range(16.0, 26.0), speed_mps: limit * 0.6 };
        let mut driver = vehicle(circle.roads.route(&lanes), start, limit, vehicle_size(dice));
        driver.holds.extend(hold(0, 3.6));
        others.push(driver);
    }
    let speed = limit * dice.range(0.6, 0.8);
    let ego = expert(
        path,
        Start { station_m: start_m, speed_mps: speed },
        limit * 0.95,
        hold(0, dice.range(3.4, 4.2)).to_vec(),
    );
    let people = dice.whole(0, 5);
    let tracks = strollers(dice, &circle.roads, DVec2::ZERO, people);
    Stage { roads: circle.roads, ego, others, tracks, place: "a roundabout" }
}

/// Returns the width of a ring lane for arms of a section.
fn dice_width(section: Section) -> f64 {
    section.lane_width_m + 1.6
}

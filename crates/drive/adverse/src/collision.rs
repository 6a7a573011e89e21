//! States in which an adversary touches the logged ego, drawn class by class: where on which way, how fast, how turned.
//!
//! Bodies touch with at most 0.3 m of overlap and come together at 2 m/s or more. All numbers are counter-based draws.

use ds_space::plane::OrientedBox;
use ds_space::{Draws, PoseSe2, Tick, angle};
use ds_vehicle::Rolling;
use ds_world::CrashClass;

use crate::road::Way;
use crate::stage::{Stage, overlap};

/// Ticks after hand-over in which contact is planned: first and last.
pub(crate) const FIRST_TICKS: u32 = 30;
pub(crate) const LAST_TICKS: u32 = 70;
/// Ticks that are driven after the contact is planned, at least.
pub(crate) const AFTER_TICKS: u32 = 10;
const DEEPEST_M: f64 = 0.3;
/// A little above the least closing speed of a valid contact, in metres per second.
const CLOSING_MPS: f64 = 2.3;
const NEAR_M: f64 = 8.0;
const ATTEMPTS: u64 = 600;
const BEFORE_M: f64 = 170.0;
const AFTER_M: f64 = 60.0;

/// A collision that is aimed at.
#[derive(Debug, Clone)]
pub(crate) struct Target {
    pub tick: u32,
    /// The adversary at that tick.
    pub car: Rolling,
    pub acceleration_mps2: f64,
    pub curvature_pm: f64,
    /// The way that it follows, as an index into the ways of the search.
    pub way: usize,
}

/// The collision states of a class, with the ways that lead to them.
#[derive(Debug, Default)]
pub(crate) struct Targets {
    pub ways: Vec<Way>,
    pub states: Vec<Target>,
    /// By lane, where its ways begin and end in `ways`.
    known: Vec<(ds_world::LaneId, std::ops::Range<usize>)>,
}

/// Draws of one attempt.
struct Dice<'a> {
    draws: &'a Draws,
    next: std::cell::Cell<u64>,
}

impl Dice<'_> {
    fn range(&self, low: f64, high: f64) -> f64 {
        let at = self.next.replace(self.next.get() + 1);
        self.draws.range(at, low, high)
    }

    fn below(&self, count: usize) -> usize {
        let at = self.next.replace(self.next.get() + 1);
        self.draws.below(at, count as u64) as usize
    }
}

/// Which end of the stretch of touching places along the way is taken.
#[derive(Clone, Copy, PartialEq)]
enum Place {
    First,
    Last,
    Between,
}

impl Targets {
    /// Draws up to `count` collision states of a class between hand-over and the last tick; fewer where the road offers
    /// none.
    pub(crate) fn draw(
        stage: &Stage<'_>,
        class: CrashClass,
        hand_over: Tick,
        last: Tick,
        count: usize,
        draws: &Draws,
    ) -> Self {
        let latest = LAST_TICKS.min(last.0 - hand_over.0 - AFTER_TICKS);
        let mut targets = Self::default();
        let mirrored = stage.road.keeps_left();
        for attempt in 0..ATTEMPTS {
            if targets.states.len() >= count || (attempt >= 150 && targets.states.is_empty()) {
                break;
            }
            let dice = Dice { draws, next: std::cell::Cell::new(attempt * 64) };
            let tick = hand_over.0 + FIRST_TICKS + dice.below((latest - FIRST_TICKS + 1) as usize) as u32;
            if let Some(target) = targets.attempt(stage, class, tick, &dice, mirrored) {
                targets.states.push(target);
            }
        }
        targets
    }

    fn attempt(
        &mut self,
        stage: &Stage<'_>,
        class: CrashClass,
        tick: u32,
        dice: &Dice<'_>,
        mirrored: bool,
    ) -> Option<Target> {
        let ego = stage.ego(tick);
        let ego_mps = stage.ego_velocity(tick).length();
        if ego_mps <= 1.0 {
            return None;
        }
        let ego_rad = ego.forward.to_angle();
        let lanes: Vec<_> = stage
            .road
            .lanes_near(ego.centre, NEAR_M)
            .into_iter()
            .filter(|(_, pose)| offers(class, ego_rad, ego, pose))
            .collect();
        if lanes.is_empty() {
            return None;
        }
        let (lane, _) = lanes[dice.below(lanes.len())];
        let ways = self.ways_of(stage, lane);
        if ways.is_empty() {
            return None;
        }
        let index = ways.start + dice.below(ways.len());
        let way = &self.ways[index];
        let here = way.beside(ego.centre, 0);
        let ego_turn_rad = turned(stage, tick);
        let (aside_m, tilt_rad) = lateral(class, here.left_m, stage, dice);
        let (speed_mps, acceleration_mps2) = pace(class, ego_mps, dice);
        let limit_mps = 1.2 * way.limit_mps(here.station_m);
        let bend_pm = way.curvature_pm(here.station_m).abs().max(1e-4);
        let speed_mps = speed_mps.min(limit_mps).min((3.0 / bend_pm).sqrt());
        let way_turn_rad = way.turn_rad(here.station_m - 4.0 * speed_mps, here.station_m);
        if !turns_fit(class, [ego_turn_rad, way_turn_rad], mirrored) {
            return None;
        }
        let pose = |station_m: f64| {
            let on = way.pose(station_m, aside_m);
            PoseSe2 { heading_rad: angle::wrap(on.heading_rad + tilt_rad), ..on }
        };
        let place = match class {
            CrashClass::RearEnd | CrashClass::ChangingLanes => Place::Last,
            CrashClass::OppositeDirection => Place::First,
            _ if dice.below(2) == 0 => Place::First,
            _ => Place::Between,
        };
        let centre = touching(stage, tick, &pose, here.station_m, place, dice)?;
        let (depth_m, normal) = overlap(ego, &stage.body.grown(&centre, 0.0));
        let closing_mps = (stage.ego_velocity(tick) - centre.forward() * speed_mps).dot(normal);
        let apart_deg = angle::turn(ego_rad, centre.heading_rad).abs().to_degrees();
        let crossing = class != CrashClass::StraightCrossingPaths || (62.0..=118.0).contains(&apart_deg);
        if !(0.0..=DEEPEST_M).contains(&depth_m) || closing_mps < CLOSING_MPS || !crossing {
            return None;
        }
        let in_junction = stage.road.in_junction(ego.centre) || stage.road.in_junction(centre.position);
        if needs_junction(class) && !in_junction {
            return None;
        }
        let rear = stage.body.rear(&centre);
        let beside = way.beside(rear.position, 0);
        Some(Target {
            tick,
            car: Rolling { pose: rear, speed_mps },
            acceleration_mps2,
            curvature_pm: beside.curvature_pm,
            way: index,
        })
    }

    fn ways_of(&mut self, stage: &Stage<'_>, lane: ds_world::LaneId) -> std::ops::Range<usize> {
        if let Some((_, range)) = self.known.iter().find(|(known, _)| *known == lane) {
            return range.clone();
        }
        let start = self.ways.len();
        self.ways.extend(stage.road.ways(lane, BEFORE_M, AFTER_M));
        let range = start..self.ways.len();
        self.known.push((lane, range.clone()));
        range
    }
}

/// Returns by how much the logged ego turns in the 4 s before a tick.
fn turned(stage: &Stage<'_>, tick: u32) -> f64 {
    (tick.saturating_sub(40)..tick)
        .map(|at| {
            let heading = |at: u32| stage.ego(at).forward.to_angle();
            angle::turn(heading(at), heading(at + 1))
        })
        .sum()
}

fn needs_junction(class: CrashClass) -> bool {
    matches!(class, CrashClass::StraightCrossingPaths | CrashClass::LeftTurnAcrossPath)
}

/// Says whether a lane can carry an adversary of a class, by how its line passes the ego.
fn offers(class: CrashClass, ego_rad: f64, ego: &OrientedBox, lane: &PoseSe2) -> bool {
    let apart_deg = angle::turn(ego_rad, lane.heading_rad).abs().to_degrees();
    let away_m = lane.left().dot(ego.centre - lane.position).abs();
    match class {
        CrashClass::RearEnd => apart_deg <= 20.0 && away_m <= 1.2,
        CrashClass::ChangingLanes => apart_deg <= 20.0 && (2.2..=5.5).contains(&away_m),
        CrashClass::OppositeDirection => apart_deg >= 155.0 && (2.0..=6.5).contains(&away_m),
        CrashClass::StraightCrossingPaths => (50.0..=130.0).contains(&apart_deg),
        CrashClass::LeftTurnAcrossPath => apart_deg >= 35.0,
    }
}

/// Returns how far left of its way the adversary's centre is, and how far turned to the left of it.
fn lateral(class: CrashClass, ego_left_m: f64, stage: &Stage<'_>, dice: &Dice<'_>) -> (f64, f64) {
    let half_m = 0.5 * (stage.body.size.width_m + stage.scene.vehicle.size.width_m);
    match class {
        CrashClass::RearEnd => (dice.range(-0.3, 0.3), 0.0),
        CrashClass::ChangingLanes | CrashClass::OppositeDirection => {
            let beside_m = dice.range(0.2, 0.9) * half_m;
            let least = if class == CrashClass::ChangingLanes { 0.02 } else { 0.04 };
            let side = ego_left_m.signum();
            (ego_left_m - side * beside_m, side * dice.range(least, 0.14))
        }
        _ => (dice.range(-0.4, 0.4), 0.0),
    }
}

/// Returns the speed and the acceleration at contact.
fn pace(class: CrashClass, ego_mps: f64, dice: &Dice<'_>) -> (f64, f64) {
    match class {
        CrashClass::RearEnd => {
            let most = (0.8 * ego_mps).min(ego_mps - 2.5).max(0.0);
            (dice.range(0.1 * ego_mps, most.max(0.1 * ego_mps)), dice.range(-5.0, -1.5))
        }
        CrashClass::ChangingLanes => {
            let most = (0.9 * ego_mps).min(ego_mps - 2.5).max(0.0);
            (dice.range(0.4 * ego_mps, most.max(0.4 * ego_mps)), dice.range(-3.0, 0.0))
        }
        CrashClass::OppositeDirection => (ego_mps * dice.range(0.6, 1.2), dice.range(-1.0, 0.5)),
        _ => ((ego_mps * dice.range(0.6, 1.5)).max(3.0), dice.range(-1.5, 1.0)),
    }
}

/// Says whether the turns of the ego and of the way in 4 s are those of the class.
fn turns_fit(class: CrashClass, turns_rad: [f64; 2], mirrored: bool) -> bool {
    let across = if mirrored { -1.0 } else { 1.0 };
    let [ego, other] = turns_rad.map(f64::to_degrees);
    match class {
        CrashClass::StraightCrossingPaths => ego.abs() < 19.0 && other.abs() < 19.0,
        CrashClass::LeftTurnAcrossPath => {
            (ego * across >= 41.0 && other.abs() < 19.0) || (other * across >= 42.0 && ego.abs() < 19.0)
        }
        _ => true,
    }
}

/// Finds a pose along a way at which the adversary touches the logged ego.
fn touching(
    stage: &Stage<'_>,
    tick: u32,
    pose: &dyn Fn(f64) -> PoseSe2,
    near_m: f64,
    place: Place,
    dice: &Dice<'_>,
) -> Option<PoseSe2> {
    const STEP_M: f64 = 0.15;
    const REACH: i32 = 60;
    let ego = stage.ego(tick);
    let touches = |station_m: f64| ego.touches(&stage.body.grown(&pose(station_m), 0.0));
    let at = |i: i32| near_m + f64::from(i) * STEP_M;
    let first = (-REACH..=REACH).find(|i| touches(at(*i)))?;
    let last = (-REACH..=REACH).rev().find(|i| touches(at(*i)))?;
    match place {
        Place::First => Some(pose(at(first))),
        Place::Last => Some(pose(at(last))),
        Place::Between => (0..16).find_map(|_| {
            let tried = pose(dice.range(at(first), at(last)));
            let (depth_m, _) = overlap(ego, &stage.body.grown(&tried, 0.0));
            (0.0..=DEEPEST_M).contains(&depth_m).then_some(tried)
        }),
    }
}

//! What a driver or somebody on foot would do over five seconds in the recorded world, from its measured state on: the
//! simulator's own rules (`ds_sim`), among others as recorded.

use ds_effect::Plant;
use ds_sim::{IdmParameters, Lead, Placed, SignalStop, Zone, lets_pass, stop_ahead, wait_ahead};
use ds_world::AgentClass;

use crate::scenery::{Actor, Mark, Scenery};

/// Length of a rollout, s.
pub const SECS: f64 = 5.0;
/// Memory before it, s.
pub const BEFORE_SECS: f64 = 1.0;
/// Hardest change of pace of somebody on foot, m/s².
const PACE_UP_MPS2: f64 = 1.0;
const PACE_DOWN_MPS2: f64 = 2.0;

/// How agents behave: the numbers of a plant that matter to them.
#[derive(Debug, Clone, Copy)]
pub struct Manner {
    /// How they follow.
    pub idm: IdmParameters,
    /// Factor on desired speeds.
    pub desired_factor: f64,
    /// Reaction time, s.
    pub delay_secs: f64,
    /// Lag of the drive, s.
    pub lag_secs: f64,
    /// Factor on the pace of people on foot.
    pub walking_factor: f64,
    /// Time gap that they accept, s.
    pub walking_gap_secs: f64,
    /// Stop lines lie so much farther, m.
    pub stop_shift_m: f64,
    /// Every place where people cross is a crosswalk.
    pub unmarked: bool,
    /// Whether drivers yield at all.
    pub yields: bool,
    /// Whether people walk by themselves.
    pub walks: bool,
    /// Whether anybody reacts.
    pub reactive: bool,
}

impl Manner {
    /// Reads them off a plant.
    #[must_use]
    pub fn of(plant: &Plant, idm: IdmParameters) -> Self {
        let driver = &plant.follower;
        Self {
            idm: IdmParameters { minimum_gap_m: driver.min_gap_m.max(0.0), ..idm.driven_by(driver) },
            desired_factor: driver.desired_speed_factor,
            delay_secs: driver.delay_secs.clamp(0.0, BEFORE_SECS + 0.5),
            lag_secs: driver.lag_secs.max(0.0),
            walking_factor: plant.agents.walking_factor,
            walking_gap_secs: plant.agents.walking_gap_secs,
            stop_shift_m: plant.chart.stop_line_shift_m,
            unmarked: plant.chart.crosswalk_missing,
            yields: plant.agents.yields,
            walks: plant.agents.walks,
            reactive: plant.agents.reactive,
        }
    }
}

impl Manner {
    /// Returns the numbers that matter to an agent of a class: equal keys, equal rollouts.
    #[must_use]
    pub fn key(&self, class: AgentClass) -> [f64; 10] {
        let switch = |on: bool| f64::from(u8::from(on));
        let idm = &self.idm;
        let both = switch(self.unmarked) + 2.0 * switch(self.reactive);
        if class == AgentClass::Pedestrian {
            return [self.walking_factor, self.walking_gap_secs, both, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        }
        let follows = [idm.headway_secs, idm.minimum_gap_m, idm.acceleration_mps2, idm.deceleration_mps2];
        let [a, b, c, d] = follows;
        [a, b, c, d, self.desired_factor, self.delay_secs, self.lag_secs, self.stop_shift_m, both, 1.0]
    }
}

/// A rollout: place and speed tick by tick after the start, and whether the driver waited at a zone.
#[derive(Debug, Clone, Default)]
pub struct Course {
    /// Along the path, m, and speed, m/s.
    pub states: Vec<[f64; 2]>,
    /// Whether it yielded to anybody.
    pub waited: bool,
}

/// Rolls an agent out from a tick; `yields` overrules whether it lets others go first.
#[must_use]
pub fn roll(scenery: &Scenery, actor: &Actor, start: usize, manner: &Manner, yields: bool) -> Course {
    let ticks = (SECS / scenery.dt_secs).round() as usize;
    if !manner.reactive && scenery.expected {
        return replay(scenery, actor, start, ticks);
    }
    if actor.class == AgentClass::Pedestrian {
        walk(scenery, actor, start, manner)
    } else {
        drive(scenery, actor, start, manner, yields)
    }
}

fn mark(actor: &Actor, tick: usize) -> Option<&Mark> {
    actor.marks.get(tick)?.as_ref()
}

/// The agent as it was logged in the scene.
fn replay(scenery: &Scenery, actor: &Actor, start: usize, ticks: usize) -> Course {
    let Some(path) = &scenery.ways.paths[actor.index] else { return Course::default() };
    let at = |tick: usize| path.along_at(ds_space::Tick(u32::try_from(tick).unwrap_or(u32::MAX)));
    let mut states = Vec::with_capacity(ticks);
    let mut last = mark(actor, start).map_or([0.0; 2], |mark| [mark.along_m, mark.speed_mps]);
    for tick in start + 1..=start + ticks {
        if let (Some(before_m), Some(here_m)) = (at(tick - 1), at(tick)) {
            last = [here_m, (here_m - before_m) / scenery.dt_secs];
        }
        states.push(last);
    }
    Course { states, waited: false }
}

fn walk(scenery: &Scenery, actor: &Actor, start: usize, manner: &Manner) -> Course {
    let (Some(path), Some(first)) = (&scenery.ways.paths[actor.index], mark(actor, start)) else {
        return Course::default();
    };
    let dt = scenery.dt_secs;
    let ticks = (SECS / dt).round() as usize;
    let (mut along_m, mut speed_mps) = (first.along_m, first.speed_mps.max(0.0));
    let zones = zones(scenery, actor, manner);
    let mut course = Course::default();
    for tick in start..start + ticks {
        let pace_mps = path.at(along_m).desired_mps * manner.walking_factor;
        let me = placed(actor, along_m, speed_mps);
        let waits = |zone: &Zone| lets_pass(&me, zone, other(scenery, tick, zone), manner.walking_gap_secs, pace_mps);
        let wanted_mps = if zones.iter().any(waits) { 0.0 } else { pace_mps };
        let next = speed_mps + (wanted_mps - speed_mps).clamp(-PACE_DOWN_MPS2 * dt, PACE_UP_MPS2 * dt);
        along_m += 0.5 * (speed_mps + next) * dt;
        speed_mps = next;
        course.states.push([along_m, speed_mps]);
    }
    course
}

fn placed(actor: &Actor, along_m: f64, speed_mps: f64) -> Placed {
    Placed { along_m, speed_mps, half_length_m: actor.half_length_m, held_before_m: f64::INFINITY }
}

fn zones<'a>(scenery: &'a Scenery, actor: &Actor, manner: &Manner) -> &'a [Zone] {
    let all = if manner.unmarked { &scenery.unmarked } else { &scenery.ways.zones };
    all.get(actor.index).map(Vec::as_slice).unwrap_or_default()
}

fn other<'a>(scenery: &'a Scenery, tick: usize, zone: &Zone) -> Option<&'a Placed> {
    scenery.places.get(tick)?.get(zone.other)?.as_ref()
}

/// A driver with what its rollout needs.
struct Driver<'a> {
    scenery: &'a Scenery,
    actor: &'a Actor,
    manner: &'a Manner,
    stops: Vec<SignalStop>,
    zones: &'a [Zone],
    yields: bool,
}

impl Driver<'_> {
    /// Returns the wished acceleration at a tick from a state, and whether it yields.
    fn wish(&self, tick: usize, along_m: f64, speed_mps: f64) -> (f64, bool) {
        let Some(path) = &self.scenery.ways.paths[self.actor.index] else { return (0.0, false) };
        let idm = &self.manner.idm;
        let usual_mps = idm.desired_speed_mps.unwrap_or_else(|| path.at(along_m).desired_mps);
        let desired_mps = usual_mps * self.manner.desired_factor;
        let nose_m = along_m + self.actor.half_length_m;
        let ahead = mark(self.actor, tick).map(|mark| mark.ahead.as_slice()).unwrap_or_default();
        let lead = ahead.iter().find(|other| other.centre_m > along_m + 0.1);
        let lead = lead.map(|other| Lead { gap_m: other.rear_m - nose_m, speed_mps: other.speed_mps });
        let mut wish = idm.acceleration(speed_mps, desired_mps, lead);
        let standing = |gap_m: f64| Some(Lead { gap_m, speed_mps: 0.0 });
        let lights = self.scenery.lights.get(tick).map(Vec::as_slice).unwrap_or_default();
        if let Some(gap_m) = stop_ahead(idm, &self.stops, nose_m, speed_mps, lights) {
            wish = wish.min(idm.acceleration(speed_mps, desired_mps, standing(gap_m)));
        }
        let me = placed(self.actor, along_m, speed_mps);
        let wait = |zone: &Zone| wait_ahead(&me, zone, other(self.scenery, tick, zone), idm.acceleration_mps2);
        let mut waits = false;
        if let Some(gap_m) = self.zones.iter().filter_map(wait).min_by(f64::total_cmp) {
            waits = true;
            if self.yields {
                wish = wish.min(idm.acceleration(speed_mps, desired_mps, standing(gap_m)));
            }
        }
        (wish, waits)
    }
}

fn drive(scenery: &Scenery, actor: &Actor, start: usize, manner: &Manner, yields: bool) -> Course {
    let Some(first) = mark(actor, start) else { return Course::default() };
    let dt = scenery.dt_secs;
    let ticks = (SECS / dt).round() as usize;
    let mut stops = scenery.ways.stops.get(actor.index).cloned().unwrap_or_default();
    stops.iter_mut().for_each(|stop| stop.along_m += manner.stop_shift_m);
    let driver = Driver { scenery, actor, manner, stops, zones: zones(scenery, actor, manner), yields };
    let back = manner.delay_secs / dt;
    // Wishes of the past, newest last, from measured states.
    let memory = back.ceil() as usize + 1;
    let mut wishes: Vec<f64> = Vec::with_capacity(memory + ticks);
    for k in (1..=memory).rev() {
        let tick = start.saturating_sub(k);
        let wish = mark(actor, tick).map_or(0.0, |mark| driver.wish(tick, mark.along_m, mark.speed_mps).0);
        wishes.push(wish);
    }
    let late = |wishes: &[f64]| {
        let at = (wishes.len() - 1) as f64 - back;
        let low = at.max(0.0).floor() as usize;
        let high = (low + 1).min(wishes.len() - 1);
        wishes[low] + (at - low as f64).clamp(0.0, 1.0) * (wishes[high] - wishes[low])
    };
    let (mut along_m, mut speed_mps) = (first.along_m, first.speed_mps.max(0.0));
    let mut had = late(&wishes);
    let decay = if manner.lag_secs > 1e-3 { (-dt / manner.lag_secs).exp() } else { 0.0 };
    let mut course = Course::default();
    for tick in start..start + ticks {
        let (wish, waits) = driver.wish(tick, along_m, speed_mps);
        course.waited |= waits;
        wishes.push(wish);
        let wanted = late(&wishes);
        had = wanted + (had - wanted) * decay;
        let next = (speed_mps + had * dt).clamp(0.0, 60.0);
        along_m += 0.5 * (speed_mps + next) * dt;
        speed_mps = next;
        course.states.push([along_m, speed_mps]);
    }
    course
}

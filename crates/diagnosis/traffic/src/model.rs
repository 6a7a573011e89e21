//! Residuals of recorded agents in floor units: place and speed over five-second rollouts, place across the lane, and
//! decisions (lane changes, yielding, use of lanes) as the residuals that have their log likelihood.

use std::sync::{Arc, Mutex};

use ds_dynamics::fit::{Model, data_loss};
use ds_dynamics::settings::{KAPPA, NU};
use ds_sim::IdmParameters;
use ds_stats::upper_median;
use ds_world::AgentClass;
use rayon::prelude::*;

use crate::case::Case;
use crate::decide::{self, Look};
use crate::rollout::{BEFORE_SECS, Course, Manner, SECS, roll};
use crate::scenery::{Actor, Scenery, prepare};
use crate::settings::{ASIDE_FLOOR_M, BLOCK_SECS, LAPSE_SHARE, PLACE_FLOOR_M, PLACE_M, SPEED_FLOOR_MPS, STRIDE_SECS};
use crate::space::Space;

/// Scored instants of a rollout.
pub const BLOCKS: usize = 10;
/// Residuals of an agent besides its rollouts: place across the lane, lane changes, yielding, use of lanes.
pub const DECISIONS: usize = 4;
/// Farther than half a lane outside the last lane, a driver is where the map has no lane, m.
const OUTSIDE_M: [f64; 2] = [-5.0, -2.2];
/// Share of drivers in the last lane who would use one beyond it, and of those who stray without.
const BEYOND_SHARE: f64 = 0.5;

/// What a residual is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Place along the path.
    Place,
    /// Speed.
    Speed,
    /// Place across the lane.
    Aside,
    /// A decision.
    Decision,
}

/// Where a residual belongs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tag {
    /// Place among the actors.
    pub actor: usize,
    /// What it is about.
    pub kind: Kind,
    /// Start of the rollout, s.
    pub secs: f64,
    /// 50 m tile of the map.
    pub place: [i64; 2],
}

/// An actor with what is fitted of it.
pub struct Judged {
    /// The actor.
    pub actor: Actor,
    /// Starts of its rollouts, as ticks.
    pub starts: Vec<usize>,
    looks: Vec<Look>,
    aside_m: Option<f64>,
    outside: Option<bool>,
    /// What it did under the last manners that were asked for.
    memory: Mutex<Vec<([f64; 10], Arc<Rolled>)>>,
}

/// Residuals of an actor's rollouts, and where it waited those of one who does not.
#[derive(Default)]
struct Rolled {
    rows: Vec<f64>,
    waiting: Vec<(usize, Vec<f64>)>,
}

/// Manners under which an actor's rollouts are remembered.
const REMEMBERED: usize = 24;

/// The recorded agents of a case as a model of the effects on them.
pub struct Traffic {
    /// The space.
    pub space: Space,
    /// The recordings made ready.
    pub sceneries: Vec<Scenery>,
    /// The agents.
    pub judged: Vec<Judged>,
    idm: IdmParameters,
    /// Which of the agents count, for fits that leave some out.
    pub counted: Vec<bool>,
    aside_floor_m: f64,
}

impl Traffic {
    /// Makes the model of a case.
    #[must_use]
    pub fn new(case: &Case, without: &[String]) -> Self {
        let idm = case.nominal.idm();
        let (sceneries, actors) = prepare(case);
        let judged: Vec<Judged> = actors
            .into_par_iter()
            .map(|actor| {
                let scenery = &sceneries[actor.recording];
                let looks = decide::looks(scenery, &case.recordings[actor.recording], &actor, &idm);
                Judged::new(actor, scenery, looks)
            })
            .filter(|judged| !judged.starts.is_empty())
            .collect();
        let counted = vec![true; judged.len()];
        let expected = sceneries.iter().all(|scenery| scenery.expected);
        let aside_floor_m = ASIDE_FLOOR_M[usize::from(!expected)];
        Self { space: Space::new(idm, without), sceneries, judged, idm, counted, aside_floor_m }
    }

    /// Returns how agents behave at a vector.
    #[must_use]
    pub fn manner(&self, vector: &[f64]) -> Manner {
        Manner::of(&self.space.plant(vector), self.idm)
    }

    /// Returns the scenery of an actor.
    #[must_use]
    pub fn scenery(&self, actor: &Actor) -> &Scenery {
        &self.sceneries[actor.recording]
    }

    /// Returns where each residual belongs, in their order.
    #[must_use]
    pub fn tags(&self) -> Vec<Tag> {
        let mut tags = Vec::new();
        for (index, judged) in self.judged.iter().enumerate() {
            let dt_secs = self.scenery(&judged.actor).dt_secs;
            let tag = |kind, tick: usize| {
                let path = self.scenery(&judged.actor).ways.paths[judged.actor.index].as_ref();
                let mark = judged.actor.marks.get(tick).and_then(Option::as_ref);
                let at = path.zip(mark).map(|(path, mark)| path.at(mark.along_m).pose.position).unwrap_or_default();
                let place = [(at.x / PLACE_M).floor() as i64, (at.y / PLACE_M).floor() as i64];
                Tag { actor: index, kind, secs: tick as f64 * dt_secs, place }
            };
            for &start in &judged.starts {
                for kind in [Kind::Place, Kind::Speed] {
                    tags.extend((0..BLOCKS).map(|_| tag(kind, start)));
                }
            }
            let first = judged.starts[0];
            tags.extend([tag(Kind::Aside, first), tag(Kind::Decision, first), tag(Kind::Decision, first)]);
            tags.push(tag(Kind::Decision, first));
        }
        tags
    }

    /// Returns the rollouts of an actor, from memory where it behaved like that before.
    fn rolled(&self, judged: &Judged, manner: &Manner) -> Arc<Rolled> {
        let key = manner.key(judged.actor.class);
        let known = |memory: &Vec<([f64; 10], Arc<Rolled>)>| {
            memory.iter().find(|(other, _)| *other == key).map(|(_, rolled)| Arc::clone(rolled))
        };
        if let Some(rolled) = judged.memory.lock().ok().and_then(|memory| known(&memory)) {
            return rolled;
        }
        let scenery = self.scenery(&judged.actor);
        let mut rolled = Rolled::default();
        for &start in &judged.starts {
            let course = roll(scenery, &judged.actor, start, manner, true);
            let rows = judged.residuals(scenery, start, &course);
            if course.waited {
                let stubborn = roll(scenery, &judged.actor, start, manner, false);
                rolled.waiting.push((rolled.rows.len(), judged.residuals(scenery, start, &stubborn)));
            }
            rolled.rows.extend(rows);
        }
        let rolled = Arc::new(rolled);
        if let Ok(mut memory) = judged.memory.lock() {
            memory.push((key, Arc::clone(&rolled)));
            if memory.len() > REMEMBERED {
                memory.remove(0);
            }
        }
        rolled
    }

    fn of_actor(&self, judged: &Judged, vector: &[f64], manner: &Manner) -> Vec<f64> {
        let rolled = self.rolled(judged, manner);
        let mut out = rolled.rows.clone();
        let yields = self.yielding(&rolled, vector);
        if yields.1 {
            for (at, stubborn) in &rolled.waiting {
                out[*at..at + stubborn.len()].copy_from_slice(stubborn);
            }
        }
        let offset_m = self.space.value("lane_offset", vector).unwrap_or(0.0);
        let aside = judged.aside_m.map_or(0.0, |aside_m| (aside_m - offset_m) / self.aside_floor_m);
        // One look at an agent: its weight is not shared with neighbours in time.
        out.push(aside / KAPPA.sqrt());
        let politeness = self.space.value("lane_change_politeness", vector).unwrap_or(0.25);
        out.push(pseudo(decide::loss(&judged.looks, politeness)));
        out.push(pseudo(yields.0));
        let beyond = self.space.value("missing_lane", vector).unwrap_or(0.0) > 0.5;
        let share = if beyond { BEYOND_SHARE } else { 0.01 };
        out.push(judged.outside.map_or(0.0, |outside| pseudo(-f64::ln(if outside { share } else { 1.0 - share }))));
        out
    }

    /// Returns the cost of what a driver is like, and whether it is one who never yields.
    fn yielding(&self, rolled: &Rolled, vector: &[f64]) -> (f64, bool) {
        if rolled.waiting.is_empty() {
            return (0.0, false);
        }
        let share = self.space.value("non_yielding", vector).unwrap_or(0.0).clamp(LAPSE_SHARE, 1.0 - LAPSE_SHARE);
        let loss = data_loss;
        let rude: f64 = rolled.waiting.iter().map(|(_, rows)| loss(rows)).sum();
        let kind: f64 = rolled.waiting.iter().map(|(at, rows)| loss(&rolled.rows[*at..at + rows.len()])).sum();
        let (courteous, stubborn) = (kind - (1.0 - share).ln(), rude - share.ln());
        if stubborn < courteous { (-share.ln(), true) } else { (-(1.0 - share).ln(), false) }
    }
}

/// Returns the residual whose tempered Student-t loss is a given log likelihood.
fn pseudo(loss: f64) -> f64 {
    let scale = KAPPA * 0.5 * (NU + 1.0);
    (NU * ((loss / scale).clamp(0.0, 40.0).exp() - 1.0)).sqrt()
}

impl Traffic {
    /// Returns the residuals of the agents that count, zeros for the others.
    #[must_use]
    pub fn residuals_of(&self, vector: &[f64], counted: &[bool]) -> Vec<f64> {
        let manner = self.manner(vector);
        let one = |(judged, counted): (&Judged, &bool)| {
            if *counted {
                self.of_actor(judged, vector, &manner)
            } else {
                vec![0.0; 2 * BLOCKS * judged.starts.len() + DECISIONS]
            }
        };
        let parts: Vec<Vec<f64>> = self.judged.par_iter().zip(counted.par_iter()).map(one).collect();
        parts.concat()
    }
}

impl Model for Traffic {
    fn residuals(&self, vector: &[f64]) -> Vec<f64> {
        self.residuals_of(vector, &self.counted)
    }

    fn step(&self, coordinate: usize) -> f64 {
        self.space.step(coordinate)
    }
}

impl Judged {
    fn new(actor: Actor, scenery: &Scenery, looks: Vec<Look>) -> Self {
        let ticks = |secs: f64| (secs / scenery.dt_secs).round() as usize;
        let (length, before) = (ticks(SECS), ticks(BEFORE_SECS));
        let seen = |range: std::ops::RangeInclusive<usize>| {
            actor.marks.get(range).is_some_and(|marks| marks.iter().all(Option::is_some))
        };
        let from = scenery.from_tick + before;
        let starts = (from..actor.marks.len()).step_by(ticks(STRIDE_SECS).max(1));
        // Changing lanes is a decision of its own: who follows whom is not clear before it is done.
        let changes = decide::changes(scenery, &actor);
        let calm = |start: usize| {
            !changes
                .iter()
                .any(|&tick| (start.saturating_sub(ticks(2.5))..=start + length + ticks(2.0)).contains(&tick))
        };
        let starts: Vec<usize> = starts.filter(|start| seen(start - before..=start + length) && calm(*start)).collect();
        let vehicle = actor.class == AgentClass::Vehicle;
        let mut asides: Vec<f64> = Vec::new();
        for mark in actor.marks.iter().flatten().filter(|mark| vehicle && mark.speed_mps > 1.0) {
            asides.extend(if scenery.expected { own_lane(scenery, &actor, mark) } else { mark.beside_lane_m });
        }
        let enough = asides.len() >= ticks(2.0);
        let middle = upper_median(&mut asides).filter(|_| enough);
        let outside = middle.map(|m| (OUTSIDE_M[0]..OUTSIDE_M[1]).contains(&m));
        let aside_m = middle.filter(|m| m.abs() < 1.75);
        Self { actor, starts, looks, aside_m, outside, memory: Mutex::default() }
    }

    /// Returns how far the agent keeps to the left of its lane, where it is seen in one long enough.
    #[must_use]
    pub fn aside_m(&self) -> Option<f64> {
        self.aside_m
    }

    /// Returns place and speed errors of a course in floor units.
    fn residuals(&self, scenery: &Scenery, start: usize, course: &Course) -> Vec<f64> {
        let mut out = vec![0.0; 2 * BLOCKS];
        for block in 0..BLOCKS {
            let secs = BLOCK_SECS * (block + 1) as f64;
            let ahead = (secs / scenery.dt_secs).round() as usize;
            let mark = self.actor.marks.get(start + ahead).and_then(Option::as_ref);
            let (Some(mark), Some([along_m, speed_mps])) = (mark, course.states.get(ahead - 1)) else { continue };
            let [white, first, second] = PLACE_FLOOR_M;
            let place = (white * white + (first * secs).powi(2) + (second * secs * secs).powi(2)).sqrt();
            let [white, first] = SPEED_FLOOR_MPS;
            let speed = white.hypot(first * secs);
            out[block] = (mark.along_m - along_m) / place;
            out[BLOCKS + block] = (mark.speed_mps - speed_mps) / speed;
        }
        out
    }
}

/// Returns how far a driver is to the left of the lane it is in, as its path has it; beyond the lanes of the last one.
fn own_lane(scenery: &Scenery, actor: &Actor, mark: &crate::scenery::Mark) -> Option<f64> {
    let Some(lanes) = scenery.ways.lanes.get(actor.index) else { return Some(mark.lateral_m) };
    let offsets = (-2i8..=2).filter_map(|slot| lanes.offset_m(slot, mark.along_m));
    offsets
        .map(|offset_m| mark.lateral_m - offset_m)
        .min_by(|a, b| a.abs().total_cmp(&b.abs()))
        .or(Some(mark.lateral_m))
}

//! Whether a variant can be survived: an expert that may try its plans in copies of the world, and a driver who only brakes.
//!
//! The expert, here as the proof of a solution, keeps to the log until 0.5 s after the threat tick; then, every half
//! second, it takes the mildest of 9 lateral offsets × 9 accelerations that stays clear and on the road for 4 s in a copy
//! with the live adversary and misses it by 0.5 s at least where both come, or the one that misses it by most. The careful
//! driver brakes along the logged way from 0.75 s after the threat tick with the jerk and deceleration of UN R157's model.

use std::sync::Arc;

use ds_sim::{SimConfig, Simulation};
use ds_space::plane::Path;
use ds_space::{Digest, DigestWriter, PoseSe2, SimTime, Tick, angle};
use ds_world::{Scene, Trajectory, TrajectoryPoint};

use crate::encroachment::Passing;
use crate::reach::Reach;
use crate::road::Road;

const REACTION_TICKS: u32 = 5;
const CAREFUL_TICKS: u32 = 8;
const CAREFUL_MPS2: f64 = 7.59;
const CAREFUL_MPS3: f64 = 12.65;
const REPLAN_TICKS: u32 = 5;
const LOOK: Look = Look { ticks: 40, apart_ticks: 5 };
/// Mildest first.
const LATERALS_M: [f64; 9] = [0.0, 0.9, -0.9, 1.8, -1.8, 2.7, -2.7, 3.6, -3.6];
const ACCELERATIONS_MPS2: [f64; 9] = [0.0, -1.0, 1.0, -2.0, 2.0, -3.5, -5.0, -6.3, -7.6];
const SIDEWAYS_SECS: f64 = 2.0;
const PLAN_POINTS: u32 = 30;
const POINT_SECS: f64 = 0.2;

/// A drive that meets nobody and stays on the road.
#[derive(Debug, Clone, PartialEq)]
pub struct Solution {
    /// The first tick at which the ego is not on its log.
    pub from: Tick,
    /// The rear axle of each tick from then on.
    pub poses: Vec<PoseSe2>,
    /// Ticks between ego and adversary at a place where both come, at the least; none if there is no such place.
    pub post_encroachment_ticks: Option<u32>,
}

impl Solution {
    /// Returns the digest over its first tick and its poses.
    #[must_use]
    pub fn digest(&self) -> Digest {
        let mut writer = DigestWriter::new();
        writer.u32(self.from.0).u64(self.poses.len() as u64);
        for pose in &self.poses {
            writer.f64s(&[pose.position.x, pose.position.y, pose.heading_rad]);
        }
        writer.finish()
    }
}

/// Lets the expert drive a variant again that leaves its log at tick `from`, to tick `last`; nothing if it meets anybody or
/// leaves the road.
#[must_use]
pub fn solved_again(scene: &Arc<Scene>, from: Tick, last: Tick) -> Option<Solution> {
    let road = Road::new(&scene.map);
    let threat = Tick(from.0.checked_sub(REACTION_TICKS)?);
    Trial { scene, road: &road, threat, last }.expert()
}

/// A variant as a world in which an ego can be tried.
#[derive(Clone, Copy)]
pub(crate) struct Trial<'a> {
    pub scene: &'a Arc<Scene>,
    pub road: &'a Road<'a>,
    pub threat: Tick,
    pub last: Tick,
}

/// How the ego is to move from now on: sideways to an offset from the logged way, and at an acceleration.
#[derive(Debug, Clone, Copy)]
struct Wish {
    left_m: f64,
    acceleration_mps2: f64,
    /// Time until the acceleration is reached.
    ramp_secs: f64,
}

/// What a plan is to hold in a copy of the world.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Look {
    /// For so long it touches nobody and stays on the road.
    pub ticks: u32,
    /// The time it leaves, if one does, between ego and adversary at a place where both come.
    pub apart_ticks: u32,
}

impl Trial<'_> {
    fn begin(&self, until: Tick) -> Option<Simulation> {
        let config = SimConfig { agents: None, ..SimConfig::default() };
        let mut simulation = Simulation::new(Arc::clone(self.scene), config, Tick(0)).ok()?;
        while simulation.state().tick < until {
            simulation.step();
            if !clear(self.road, &simulation) {
                return None;
            }
        }
        Some(simulation)
    }

    /// Returns the tick at which nothing is left of what an ego reaches that reacts as the expert does, and keeps out of the way
    /// of a planned contact and of others as they are logged: the proof that there is no drive.
    pub(crate) fn emptied(&self, contact: Tick) -> Option<Tick> {
        Reach::new(self.scene, self.road)?.emptied(self.threat.plus(REACTION_TICKS), contact)
    }

    /// Returns the expert's drive, if it finds one that is clear to the end.
    pub(crate) fn expert(&self) -> Option<Solution> {
        let way = logged_way(self.scene)?;
        let from = self.threat.plus(REACTION_TICKS);
        let mut simulation = self.begin(from)?;
        let mut poses = vec![simulation.state().ego.pose];
        let mut passing = Passing::default();
        passing.see(&simulation);
        while simulation.state().tick < self.last {
            let plan = choose(self.road, &simulation, LOOK, wishes(&simulation, &way))?;
            simulation.begin_plan(&plan);
            for _ in 0..REPLAN_TICKS {
                simulation.step();
                if !clear(self.road, &simulation) {
                    return None;
                }
                poses.push(simulation.state().ego.pose);
                passing.see(&simulation);
            }
        }
        Some(Solution { from, poses, post_encroachment_ticks: passing.post_encroachment_ticks() })
    }

    /// Returns how many ticks after the threat tick the expert may begin at the latest and still find a drive; `contact` is
    /// when the log meets the adversary.
    pub(crate) fn margin_ticks(&self, contact: Tick) -> Option<u32> {
        let begins = (self.threat.0 + REACTION_TICKS)..contact.0;
        let solves = |from: &u32| Trial { threat: Tick(from - REACTION_TICKS), ..*self }.expert().is_some();
        begins.rev().find(solves).map(|from| from - self.threat.0)
    }

    /// Says whether a driver who only brakes meets nobody.
    pub(crate) fn careful(&self) -> bool {
        let drive = || {
            let way = logged_way(self.scene)?;
            let mut simulation = self.begin(self.threat.plus(CAREFUL_TICKS))?;
            let ramp_secs = CAREFUL_MPS2 / CAREFUL_MPS3;
            let here = way.nearest(simulation.state().ego.pose.position).left_m;
            let wish = Wish { left_m: here, acceleration_mps2: -CAREFUL_MPS2, ramp_secs };
            simulation.begin_plan(&planned(&simulation, &way, wish)?);
            while simulation.state().tick < self.last {
                simulation.step();
                if !simulation.state().contacts.is_empty() {
                    return None;
                }
            }
            Some(())
        };
        drive().is_some()
    }
}

/// Returns the line that the ego was logged on.
pub(crate) fn logged_way(scene: &Scene) -> Option<Path> {
    let points: Vec<_> = scene.ego_log.iter().map(|ego| ego.pose.position).collect();
    Path::new(&points)
}

/// Says whether the ego touches nobody and stands on the road.
fn clear(road: &Road<'_>, simulation: &Simulation) -> bool {
    let state = simulation.state();
    let vehicle = &simulation.scene().vehicle;
    state.contacts.is_empty() && road.holds(&state.ego.corners(vehicle), &state.ego.centre(vehicle))
}

/// Returns the plans of all wishes from now on, the mildest first.
pub(crate) fn wishes(simulation: &Simulation, way: &Path) -> impl Iterator<Item = Trajectory> {
    let mut wishes: Vec<(f64, Wish)> = Vec::new();
    for acceleration_mps2 in ACCELERATIONS_MPS2 {
        for left_m in LATERALS_M {
            let wish = Wish { left_m, acceleration_mps2, ramp_secs: 0.3 };
            wishes.push((left_m.abs() + acceleration_mps2.abs(), wish));
        }
    }
    wishes.sort_by(|a, b| a.0.total_cmp(&b.0));
    wishes.into_iter().map_while(|(_, wish)| planned(simulation, way, wish))
}

/// Returns the first plan that stays clear for as long as is looked and misses the adversary by as much as is asked; of those
/// that are clear and miss it by less the one that does so by most, and if none is clear, the one that stays so longest.
pub(crate) fn choose(
    road: &Road<'_>,
    simulation: &Simulation,
    look: Look,
    plans: impl Iterator<Item = Trajectory>,
) -> Option<Trajectory> {
    let mut best: Option<([u32; 2], Trajectory)> = None;
    for plan in plans {
        let found = look.at(road, simulation, &plan);
        if found == [look.ticks, look.apart_ticks] {
            return Some(plan);
        }
        if best.as_ref().is_none_or(|(most, _)| found > *most) {
            best = Some((found, plan));
        }
    }
    best.map(|(_, plan)| plan)
}

impl Look {
    /// Returns for how many ticks a plan stays clear in a copy of the world and, if for all of them, by how many it misses the
    /// adversary, up to what is asked.
    fn at(self, road: &Road<'_>, simulation: &Simulation, plan: &Trajectory) -> [u32; 2] {
        let mut copy = simulation.clone();
        copy.begin_plan(plan);
        let mut passing = Passing::default();
        for tick in 0..self.ticks {
            copy.step();
            if !clear(road, &copy) {
                return [tick, 0];
            }
            passing.see(&copy);
        }
        let apart = if self.apart_ticks > 0 { passing.post_encroachment_ticks() } else { None };
        [self.ticks, apart.unwrap_or(self.apart_ticks).min(self.apart_ticks)]
    }
}

/// Returns the plan of a wish from now on, in the rig of now.
fn planned(simulation: &Simulation, way: &Path, wish: Wish) -> Option<Trajectory> {
    let ego = &simulation.state().ego;
    let foot = way.nearest(ego.pose.position);
    let mut speed_mps = ego.speed_mps().max(0.0);
    let (mut along_m, mut secs) = (foot.station_m, 0.0);
    let mut points = Vec::new();
    let mut before = ego.pose;
    for i in 1..=PLAN_POINTS {
        let end_secs = f64::from(i) * POINT_SECS;
        while secs < end_secs - 1e-9 {
            let share = (secs / wish.ramp_secs).min(1.0);
            let next_mps = (speed_mps + share * wish.acceleration_mps2 * 0.05).max(0.0);
            along_m += 0.5 * (speed_mps + next_mps) * 0.05;
            speed_mps = next_mps;
            secs += 0.05;
        }
        let share = (end_secs / SIDEWAYS_SECS).min(1.0);
        let eased = share * share * (3.0 - 2.0 * share);
        let on = way.pose(along_m);
        let position = on.position + on.left() * (foot.left_m + eased * (wish.left_m - foot.left_m));
        let step = position - before.position;
        let heading_rad = if step.length() > 0.1 { step.to_angle() } else { before.heading_rad };
        before = PoseSe2 { position, heading_rad: angle::wrap(heading_rad) };
        points.push(TrajectoryPoint { after: SimTime::from_secs(end_secs), pose: ego.pose.relative(&before) });
    }
    Trajectory::new(points).ok()
}

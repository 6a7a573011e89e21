//! All agents: replayed from the log or following their path under the intelligent driver model.
//!
//! Followers react to the ego and all moving classes in their corridor ahead, and to red and yellow lights; cones and
//! barriers are not obstacles (their logged path avoids them). Lane changes, yielding and walking are `habits`. All
//! agents step at once from the same world state, and order never matters. Followers leave at the end of their extended
//! path. World frame.

use std::sync::Arc;

use ds_effect::plant::{Chart, Follower, Plant};
use ds_space::{AgentId, DVec2, PoseSe2, Tick};
use ds_vehicle::{IdmParameters, Lead};
use ds_world::{AgentClass, AgentState, Scene, TrackPoint, WorldState};

use crate::adversary::{self, Hunter};
use crate::agent_path::AgentPath;
use crate::habits::Habits;
use crate::lane_change::{Changer, Neighbour};
use crate::participant::{Motion, Obstructing};
use crate::settings::{IdmScope, SimConfig};
use crate::signal;
use crate::track_paths::TrackPaths;

/// Agents farther behind the ego than this stay as logged.
const BEHIND_REACH_M: f64 = 100.0;
/// Agents within this distance of the ego react in a rollout.
const NEAR_REACH_M: f64 = 50.0;
/// Look-ahead of a follower: a standing part, seconds of travel and a limit.
const REACH_M: f64 = 10.0;
const REACH_SECS: f64 = 4.0;
const LONGEST_REACH_M: f64 = 120.0;
/// Drivers look so far behind before they change lanes.
const LOOK_BACK_M: f64 = 60.0;
/// Hardest change of pace of somebody on foot, m/s².
const PACE_UP_MPS2: f64 = 1.0;
const PACE_DOWN_MPS2: f64 = 2.0;

/// The agents of a scene.
#[derive(Debug, Clone)]
pub(crate) struct Traffic {
    reacting: Option<IdmScope>,
    idm: IdmParameters,
    /// Shared by all copies.
    ways: Arc<TrackPaths>,
    motions: Vec<Motion>,
    /// Accelerations that each follower has wished for but not yet reacted with, oldest first; then the one it has.
    wishes: Vec<Vec<f64>>,
    /// Factor on desired speeds, reaction time and drive lag of followers, both in seconds.
    desired_factor: f64,
    delay_secs: f64,
    lag_secs: f64,
    obstacles: Vec<Obstacle>,
    habits: Habits,
    /// The track that no scope names: it drives as planned, or hunts.
    adversary: Option<AgentId>,
    hunter: Option<Hunter>,
}

/// What a follower may have to stop for.
#[derive(Debug, Clone, Copy)]
struct Obstacle {
    agent: Option<AgentId>,
    position: DVec2,
    forward: DVec2,
    velocity_mps: DVec2,
    half_length_m: f64,
    half_width_m: f64,
    radius_m: f64,
}

impl Traffic {
    pub(crate) fn new(scene: &Scene, config: &SimConfig, plant: &Plant) -> Self {
        let (tracks, driver): (usize, Follower) = (scene.tracks.len(), plant.follower);
        let ways = Arc::new(match config.agents {
            Some(_) => TrackPaths::new(scene, &plant.agents, &plant.chart),
            None if plant.chart != Chart::default() => TrackPaths::logged(scene),
            None => TrackPaths::none(tracks),
        });
        let habits = Habits::new(scene, Arc::clone(&ways), plant);
        Self {
            reacting: config.agents,
            idm: config.idm.driven_by(&driver),
            ways,
            motions: vec![Motion::Replay; tracks],
            wishes: vec![Vec::new(); tracks],
            desired_factor: driver.desired_speed_factor,
            delay_secs: driver.delay_secs.max(0.0),
            lag_secs: driver.lag_secs.max(0.0),
            obstacles: Vec::with_capacity(tracks + 1),
            habits,
            adversary: scene.adversary.as_ref().map(|adversary| adversary.track),
            hunter: Hunter::of(scene),
        }
    }

    /// Returns the state of an adversary that does not only replay its track.
    pub(crate) fn hunter(&self) -> Option<[f64; adversary::NUMBERS]> {
        self.hunter.as_ref().map(Hunter::numbers)
    }

    /// Returns the state of all lane changes; nothing where nobody changes lanes.
    pub(crate) fn weaves(&self) -> Vec<[f64; 3]> {
        self.habits.weaves()
    }

    /// Lets agents near the ego react from now on, whatever the scope was; without any if the log is replayed.
    pub(crate) fn react_nearby(&mut self) {
        self.reacting = self.reacting.map(|_| IdmScope::Near);
    }

    pub(crate) fn motions(&self) -> &[Motion] {
        &self.motions
    }

    pub(crate) fn wishes(&self) -> &[Vec<f64>] {
        &self.wishes
    }

    /// Takes over motions and pending reactions, or names the first that does not fit the scene.
    pub(crate) fn set_motions(
        &mut self,
        motions: Vec<Motion>,
        wishes: Vec<Vec<f64>>,
        weaves: &[[f64; 3]],
        hunter: Option<&[f64; adversary::NUMBERS]>,
    ) -> Result<(), (&'static str, f64)> {
        if let (Some(mine), Some(numbers)) = (&mut self.hunter, hunter) {
            mine.set_numbers(numbers)?;
        }
        if motions.len() != self.motions.len() || wishes.len() != motions.len() {
            return Err(("agents", motions.len() as f64));
        }
        for (motion, path) in motions.iter().zip(self.ways.paths.iter()) {
            if let Motion::Following { along_m, speed_mps } = motion {
                let length_m = path.as_ref().map_or(-1.0, AgentPath::length_m);
                if !(0.0..=length_m).contains(along_m) {
                    return Err(("agent.along_m", *along_m));
                }
                if !(0.0..=1e3).contains(speed_mps) {
                    return Err(("agent.speed_mps", *speed_mps));
                }
            }
        }
        self.habits.set_weaves(weaves)?;
        self.motions = motions;
        self.wishes = wishes;
        Ok(())
    }

    /// Returns the acceleration with which a follower reacts now: what it wished for a reaction time ago (it held its
    /// speed before), behind the lag of its drive.
    fn react(&mut self, follower: usize, wish_mps2: f64, dt_secs: f64) -> f64 {
        if self.delay_secs == 0.0 && self.lag_secs == 0.0 {
            return wish_mps2;
        }
        let wishes = &mut self.wishes[follower];
        let whole = (self.delay_secs / dt_secs).floor();
        let length = whole as usize + 3;
        if wishes.is_empty() {
            wishes.resize(length, 0.0);
        }
        let had_mps2 = wishes.pop().unwrap_or(0.0);
        wishes.remove(0);
        wishes.push(wish_mps2);
        let (late, later) = (wishes[1], wishes[0]);
        let share = self.delay_secs / dt_secs - whole;
        let wished = late + share * (later - late);
        let has = had_mps2 + (1.0 - (-dt_secs / self.lag_secs.max(1e-9)).exp()) * (wished - had_mps2);
        wishes.push(has);
        has
    }

    /// Lets those agents react from now on that the scope names at this state.
    pub(crate) fn engage(&mut self, world: &WorldState) {
        let Some(scope) = self.reacting else { return };
        let habits = self.habits.agents;
        if !habits.reactive {
            return;
        }
        for agent in &world.agents {
            let index = agent.id.0 as usize;
            if agent.class == AgentClass::Pedestrian && !habits.walks {
                continue;
            }
            let Some(path) = &self.ways.paths[index] else { continue };
            if self.adversary == Some(agent.id) {
                continue;
            }
            if self.motions[index] != Motion::Replay || !in_scope(scope, agent, world) {
                continue;
            }
            if let Some(along_m) = path.along_at(world.tick) {
                let speed_mps = agent.velocity_mps.dot(path.direction_at(along_m)).clamp(0.0, 60.0);
                self.motions[index] = Motion::Following { along_m, speed_mps };
            }
        }
    }

    /// Moves all followers one tick on from a world state.
    pub(crate) fn advance(&mut self, world: &WorldState, ego: Obstructing, dt_secs: f64) {
        if let Some(hunter) = &mut self.hunter {
            hunter.advance(world);
        }
        if self.motions.iter().all(|motion| !matches!(motion, Motion::Following { .. })) {
            return;
        }
        self.obstacles.clear();
        self.obstacles.extend(world.agents.iter().filter(|agent| !agent.class.is_static()).map(Obstacle::of));
        self.obstacles.push(Obstacle::of_ego(ego));
        let ways = Arc::clone(&self.ways);
        self.habits.place(world, ego, &self.motions);
        let wanted = self.lane_changes(world);
        for agent in &world.agents {
            let index = agent.id.0 as usize;
            let Motion::Following { along_m, speed_mps } = self.motions[index] else { continue };
            let Some(path) = &ways.paths[index] else { continue };
            let next_mps = if agent.class == AgentClass::Pedestrian {
                self.pace(index, path.at(along_m).desired_mps, speed_mps, dt_secs)
            } else {
                let wish_mps2 = self.wish(world, agent, path, along_m, speed_mps);
                let acceleration = self.react(index, wish_mps2, dt_secs);
                (speed_mps + acceleration * dt_secs).clamp(0.0, 60.0)
            };
            let along_m = along_m + 0.5 * (speed_mps + next_mps) * dt_secs;
            self.motions[index] = if along_m >= path.length_m() {
                Motion::Gone
            } else {
                Motion::Following { along_m, speed_mps: next_mps }
            };
            self.habits.go_on(index, wanted.get(index).copied().flatten(), speed_mps, dt_secs);
        }
    }

    /// Returns the acceleration that a driver wishes for: behind whom it follows, at lights, and where it yields.
    fn wish(&self, world: &WorldState, agent: &AgentState, path: &AgentPath, along_m: f64, speed_mps: f64) -> f64 {
        let index = agent.id.0 as usize;
        let desired_mps = self.desired(path, along_m);
        let (aside_m, _) = self.habits.aside(index, along_m, speed_mps);
        let lead = self.lead(path, agent, along_m, aside_m, speed_mps);
        let mut acceleration = self.idm.acceleration(speed_mps, desired_mps, lead);
        if let Some(target_m) = self.habits.target_m(index, along_m) {
            let lead = self.lead(path, agent, along_m, target_m, speed_mps);
            acceleration = acceleration.min(self.idm.acceleration(speed_mps, desired_mps, lead));
        }
        let nose_m = along_m + 0.5 * agent.size.length_m;
        let standing = |gap_m: f64| Some(Lead { gap_m, speed_mps: 0.0 });
        let stops = &self.ways.stops[index];
        if let Some(gap_m) = signal::stop_ahead(&self.idm, stops, nose_m, speed_mps, &world.lights) {
            acceleration = acceleration.min(self.idm.acceleration(speed_mps, desired_mps, standing(gap_m)));
        }
        if let Some(gap_m) = self.habits.wait_ahead(index, self.idm.acceleration_mps2) {
            acceleration = acceleration.min(self.idm.acceleration(speed_mps, desired_mps, standing(gap_m)));
        }
        acceleration
    }

    fn desired(&self, path: &AgentPath, along_m: f64) -> f64 {
        self.desired_factor * self.idm.desired_speed_mps.unwrap_or_else(|| path.at(along_m).desired_mps)
    }

    /// Returns the next speed of somebody on foot: towards the own pace, or to a stand before a vehicle.
    fn pace(&self, index: usize, usual_mps: f64, speed_mps: f64, dt_secs: f64) -> f64 {
        let pace_mps = usual_mps * self.habits.agents.walking_factor;
        let wanted_mps = if self.habits.lets_pass(index, pace_mps) { 0.0 } else { pace_mps };
        speed_mps + (wanted_mps - speed_mps).clamp(-PACE_DOWN_MPS2 * dt_secs, PACE_UP_MPS2 * dt_secs)
    }

    /// Returns the lane that each agent wants to change to now; empty where nobody changes lanes.
    fn lane_changes(&self, world: &WorldState) -> Vec<Option<i8>> {
        if !self.habits.agents.changes_lanes {
            return Vec::new();
        }
        let mut wanted = vec![None; self.motions.len()];
        for agent in world.agents.iter().filter(|agent| agent.class == AgentClass::Vehicle) {
            let index = agent.id.0 as usize;
            let Motion::Following { along_m, speed_mps } = self.motions[index] else { continue };
            let (Some(path), Some((weave, lanes))) = (&self.ways.paths[index], self.habits.weave(index)) else {
                continue;
            };
            if weave.busy() {
                continue;
            }
            let changer = Changer {
                idm: &self.idm,
                politeness: self.habits.agents.politeness,
                lanes,
                along_m,
                speed_mps,
                desired_mps: self.desired(path, along_m),
                half_length_m: 0.5 * agent.size.length_m,
                half_width_m: 0.5 * agent.size.width_m,
            };
            wanted[index] = changer.wanted(&weave, &self.neighbours(path, agent, along_m, speed_mps));
        }
        wanted
    }

    /// Returns all that move near a driver, along its path.
    fn neighbours(&self, path: &AgentPath, agent: &AgentState, along_m: f64, speed_mps: f64) -> Vec<Neighbour> {
        let reach_m = (REACH_M + REACH_SECS * speed_mps).min(LONGEST_REACH_M);
        let stretch = path.stretch(along_m - LOOK_BACK_M, along_m + reach_m);
        let here = agent.pose.position;
        let close = |o: &&Obstacle| o.agent != Some(agent.id) && o.position.distance(here) < reach_m + LOOK_BACK_M;
        let neighbour = |obstacle: &Obstacle| {
            let near = stretch.nearest(obstacle.position);
            let (along, across) =
                (near.direction.dot(obstacle.forward).abs(), near.direction.perp_dot(obstacle.forward).abs());
            let speed_mps = obstacle.velocity_mps.dot(near.direction);
            Neighbour {
                ahead_m: near.along_m + near.direction.dot(near.off) - along_m,
                lateral_m: near.direction.perp_dot(near.off) - self.habits.shift_m(agent.id.0 as usize),
                half_across_m: across * obstacle.half_length_m + along * obstacle.half_width_m,
                half_along_m: along * obstacle.half_length_m + across * obstacle.half_width_m,
                speed_mps,
                desired_mps: self.wanted_by(obstacle).unwrap_or(speed_mps).max(0.1),
            }
        };
        self.obstacles.iter().filter(close).map(neighbour).collect()
    }

    fn wanted_by(&self, obstacle: &Obstacle) -> Option<f64> {
        let index = obstacle.agent?.0 as usize;
        let Motion::Following { along_m, .. } = self.motions[index] else { return None };
        Some(self.desired(self.ways.paths[index].as_ref()?, along_m))
    }

    /// Returns the nearest obstacle in the corridor of a follower, which runs so far to the left of its path.
    fn lead(&self, path: &AgentPath, agent: &AgentState, along_m: f64, aside_m: f64, speed_mps: f64) -> Option<Lead> {
        let (half_length_m, half_width_m) = (0.5 * agent.size.length_m, 0.5 * agent.size.width_m);
        let reach_m = (REACH_M + REACH_SECS * speed_mps).min(LONGEST_REACH_M);
        let stretch = path.stretch(along_m, along_m + half_length_m + reach_m);
        let (low, high) = stretch.bounds();
        let mut nearest: Option<Lead> = None;
        for obstacle in &self.obstacles {
            let margin_m = obstacle.radius_m + half_width_m + aside_m.abs();
            let beside =
                obstacle.position.cmplt(low - margin_m).any() || obstacle.position.cmpgt(high + margin_m).any();
            if beside || obstacle.agent == Some(agent.id) {
                continue;
            }
            let near = stretch.nearest(obstacle.position);
            let (along, across) =
                (near.direction.dot(obstacle.forward).abs(), near.direction.perp_dot(obstacle.forward).abs());
            let across_m = across * obstacle.half_length_m + along * obstacle.half_width_m;
            let distance_m =
                if aside_m == 0.0 { near.distance_m } else { (near.direction.perp_dot(near.off) - aside_m).abs() };
            if near.along_m <= along_m + 0.1 || distance_m >= across_m + half_width_m {
                continue;
            }
            let along_half_m = along * obstacle.half_length_m + across * obstacle.half_width_m;
            let gap_m = near.along_m - along_half_m - along_m - half_length_m;
            if nearest.is_none_or(|lead| gap_m < lead.gap_m) {
                nearest = Some(Lead { gap_m, speed_mps: obstacle.velocity_mps.dot(near.direction) });
            }
        }
        nearest
    }

    /// Fills in the agents that are present at a tick, sorted by id.
    pub(crate) fn show(&self, scene: &Scene, tick: Tick, out: &mut Vec<AgentState>) {
        out.clear();
        let last = scene.last_tick();
        for (index, (track, motion)) in scene.tracks.iter().zip(&self.motions).enumerate() {
            let Ok(id) = u32::try_from(index) else { break };
            let hunts = self.hunter.as_ref().filter(|hunter| hunter.track() == index).and_then(Hunter::place);
            let place = match (motion, &self.ways.paths[index]) {
                (Motion::Replay, _) if hunts.is_some() => hunts,
                (Motion::Replay, _) => track.at(tick.min(last)).map(|point| {
                    // After the log everything stands where it was last seen.
                    let velocity_mps = if tick > last { DVec2::ZERO } else { point.velocity_mps };
                    let shift_m = self.habits.shift_m(index);
                    let pose = if shift_m == 0.0 { point.pose } else { beside(point.pose, shift_m, 0.0) };
                    TrackPoint { velocity_mps, pose, ..*point }
                }),
                (Motion::Following { along_m, speed_mps }, Some(path)) => {
                    let (knot, direction) = (path.at(*along_m), path.direction_at(*along_m));
                    let velocity_mps = direction * *speed_mps;
                    let (aside_m, aside_mps) = self.habits.aside(index, *along_m, *speed_mps);
                    if aside_m == 0.0 && aside_mps == 0.0 {
                        Some(TrackPoint { pose: knot.pose, z_m: knot.z_m, velocity_mps })
                    } else {
                        let turned_rad = aside_mps.atan2(speed_mps.max(1.0));
                        let pose = beside(knot.pose, aside_m, turned_rad);
                        Some(TrackPoint {
                            pose,
                            z_m: knot.z_m,
                            velocity_mps: velocity_mps + direction.perp() * aside_mps,
                        })
                    }
                }
                (Motion::Following { .. } | Motion::Gone, _) => None,
            };
            if let Some(TrackPoint { pose, z_m, velocity_mps }) = place {
                out.push(AgentState { id: AgentId(id), class: track.class, size: track.size, pose, z_m, velocity_mps });
            }
        }
    }
}

/// Moves a pose to its left and turns it.
fn beside(pose: PoseSe2, left_m: f64, turned_rad: f64) -> PoseSe2 {
    PoseSe2 {
        position: pose.to_outer(DVec2::new(0.0, left_m)),
        heading_rad: ds_space::angle::wrap(pose.heading_rad + turned_rad),
    }
}

fn in_scope(scope: IdmScope, agent: &AgentState, world: &WorldState) -> bool {
    match scope {
        IdmScope::All => true,
        IdmScope::Near => agent.pose.position.distance(world.ego.pose.position) < NEAR_REACH_M,
        IdmScope::BehindEgo => {
            let ego = &world.ego.pose;
            let place = ego.to_local(agent.pose.position);
            place.x < 0.0 && place.length() < BEHIND_REACH_M && ego.forward().dot(agent.pose.forward()) > 0.0
        }
    }
}

impl Obstacle {
    fn of(agent: &AgentState) -> Self {
        let (half_length_m, half_width_m) = (0.5 * agent.size.length_m, 0.5 * agent.size.width_m);
        Self {
            agent: Some(agent.id),
            position: agent.pose.position,
            forward: agent.pose.forward(),
            velocity_mps: agent.velocity_mps,
            half_length_m,
            half_width_m,
            radius_m: half_length_m.hypot(half_width_m),
        }
    }

    fn of_ego(ego: Obstructing) -> Self {
        let (half_length_m, half_width_m) = (0.5 * ego.size.length_m, 0.5 * ego.size.width_m);
        Self {
            agent: None,
            position: ego.centre.position,
            forward: ego.centre.forward(),
            velocity_mps: ego.velocity_mps,
            half_length_m,
            half_width_m,
            radius_m: half_length_m.hypot(half_width_m),
        }
    }
}

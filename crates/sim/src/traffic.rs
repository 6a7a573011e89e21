//! All agents: replayed from the log or following their path under the intelligent driver model.
//!
//! Followers react to the ego and all moving classes in their corridor ahead, and to red and yellow lights; cones and
//! barriers are not obstacles (their logged path avoids them). All agents step at once from the same world state, and
//! order never matters. Followers leave at the end of their extended path. World frame.

use std::sync::Arc;

use ds_effect::plant::Follower;
use ds_space::{AgentId, DVec2, Tick};
use ds_world::{AgentState, LightState, Scene, TrackPoint, WorldState};

use crate::agent_path::AgentPath;
use crate::idm::{IdmParameters, Lead};
use crate::lane_index::LaneIndex;
use crate::settings::{AgentMode, IdmScope, SimConfig};
use crate::signal::{self, SignalStop};

/// How an agent moves now.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Motion {
    /// As logged.
    Replay,
    /// Along its path.
    Following {
        /// Distance of its centre along the path.
        along_m: f64,
        /// Its speed along the path.
        speed_mps: f64,
    },
    /// It left at the end of its path.
    Gone,
}

/// Agents farther behind the ego than this stay as logged.
const BEHIND_REACH_M: f64 = 100.0;
/// Agents within this distance of the ego react in a rollout.
const NEAR_REACH_M: f64 = 50.0;
/// Look-ahead of a follower: a standing part, seconds of travel and a limit.
const REACH_M: f64 = 10.0;
const REACH_SECS: f64 = 4.0;
const LONGEST_REACH_M: f64 = 120.0;

/// The agents of a scene.
#[derive(Debug, Clone)]
pub(crate) struct Traffic {
    mode: AgentMode,
    idm: IdmParameters,
    /// Shared by all copies.
    paths: Arc<[Option<AgentPath>]>,
    stops: Arc<[Vec<SignalStop>]>,
    motions: Vec<Motion>,
    /// Accelerations that each follower has wished for but not yet reacted with, oldest first; then the one it has.
    wishes: Vec<Vec<f64>>,
    /// Factor on desired speeds, reaction time and drive lag of followers, both in seconds.
    desired_factor: f64,
    delay_secs: f64,
    lag_secs: f64,
    obstacles: Vec<Obstacle>,
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
    pub(crate) fn new(scene: &Scene, config: &SimConfig, driver: Follower) -> Self {
        let tracks = scene.tracks.len();
        let (mut paths, mut stops) = (vec![None; tracks], vec![Vec::new(); tracks]);
        if config.agents != AgentMode::LogReplay {
            let lanes = LaneIndex::new(&scene.map);
            let lines = signal::governed_lines(&scene.map, &lanes);
            for (index, track) in scene.tracks.iter().enumerate() {
                paths[index] = AgentPath::of(track, &lanes);
                if let Some(path) = &paths[index] {
                    stops[index] = signal::stops_on(path, &lines);
                }
            }
        }
        Self {
            mode: config.agents,
            idm: IdmParameters {
                headway_secs: driver.headway_secs,
                minimum_gap_m: driver.min_gap_m,
                acceleration_mps2: driver.max_accel_mps2,
                deceleration_mps2: driver.comfort_decel_mps2,
                ..config.idm
            },
            paths: paths.into(),
            stops: stops.into(),
            motions: vec![Motion::Replay; tracks],
            wishes: vec![Vec::new(); tracks],
            desired_factor: driver.desired_speed_factor,
            delay_secs: driver.delay_secs.max(0.0),
            lag_secs: driver.lag_secs.max(0.0),
            obstacles: Vec::with_capacity(tracks + 1),
        }
    }

    /// Lets agents near the ego react from now on, whatever the scope was; without any if the log is replayed.
    pub(crate) fn react_nearby(&mut self) {
        if self.mode != AgentMode::LogReplay {
            self.mode = AgentMode::Idm { scope: IdmScope::Near };
        }
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
    ) -> Result<(), (&'static str, f64)> {
        if motions.len() != self.motions.len() || wishes.len() != motions.len() {
            return Err(("agents", motions.len() as f64));
        }
        for (motion, path) in motions.iter().zip(self.paths.iter()) {
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
        let AgentMode::Idm { scope } = self.mode else { return };
        for agent in &world.agents {
            let index = agent.id.0 as usize;
            let Some(path) = &self.paths[index] else { continue };
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
        if self.motions.iter().all(|motion| !matches!(motion, Motion::Following { .. })) {
            return;
        }
        self.obstacles.clear();
        self.obstacles.extend(world.agents.iter().filter(|agent| !agent.class.is_static()).map(Obstacle::of));
        self.obstacles.push(Obstacle::of_ego(ego));
        let paths = Arc::clone(&self.paths);
        for agent in &world.agents {
            let index = agent.id.0 as usize;
            let Motion::Following { along_m, speed_mps } = self.motions[index] else { continue };
            let Some(path) = &paths[index] else { continue };
            let desired_mps =
                self.desired_factor * self.idm.desired_speed_mps.unwrap_or_else(|| path.at(along_m).desired_mps);
            let lead = self.lead(path, agent, along_m, speed_mps);
            let mut acceleration = self.idm.acceleration(speed_mps, desired_mps, lead);
            let nose_m = along_m + 0.5 * agent.size.length_m;
            if let Some(gap_m) = self.stop_ahead(&self.stops[index], nose_m, speed_mps, &world.lights) {
                let lead = Some(Lead { gap_m, speed_mps: 0.0 });
                acceleration = acceleration.min(self.idm.acceleration(speed_mps, desired_mps, lead));
            }
            let length_m = path.length_m();
            let acceleration = self.react(index, acceleration, dt_secs);
            let next_mps = (speed_mps + acceleration * dt_secs).clamp(0.0, 60.0);
            let along_m = along_m + 0.5 * (speed_mps + next_mps) * dt_secs;
            self.motions[index] =
                if along_m >= length_m { Motion::Gone } else { Motion::Following { along_m, speed_mps: next_mps } };
        }
    }

    /// Returns the nearest obstacle in the corridor of a follower.
    fn lead(&self, path: &AgentPath, agent: &AgentState, along_m: f64, speed_mps: f64) -> Option<Lead> {
        let (half_length_m, half_width_m) = (0.5 * agent.size.length_m, 0.5 * agent.size.width_m);
        let reach_m = (REACH_M + REACH_SECS * speed_mps).min(LONGEST_REACH_M);
        let stretch = path.stretch(along_m, along_m + half_length_m + reach_m);
        let (low, high) = stretch.bounds();
        let mut nearest: Option<Lead> = None;
        for obstacle in &self.obstacles {
            let margin_m = obstacle.radius_m + half_width_m;
            let beside =
                obstacle.position.cmplt(low - margin_m).any() || obstacle.position.cmpgt(high + margin_m).any();
            if beside || obstacle.agent == Some(agent.id) {
                continue;
            }
            let near = stretch.nearest(obstacle.position);
            let (along, across) =
                (near.direction.dot(obstacle.forward).abs(), near.direction.perp_dot(obstacle.forward).abs());
            let across_m = across * obstacle.half_length_m + along * obstacle.half_width_m;
            if near.along_m <= along_m + 0.1 || near.distance_m >= across_m + half_width_m {
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

    /// Returns the gap to the first line ahead at which to stop: red if braking can do it, yellow if gentle braking can.
    fn stop_ahead(&self, stops: &[SignalStop], nose_m: f64, speed_mps: f64, lights: &[LightState]) -> Option<f64> {
        let braking_m = |deceleration: f64| speed_mps * speed_mps / (2.0 * deceleration);
        stops.iter().find_map(|stop| {
            let gap_m = stop.along_m - nose_m;
            let needed_m = match lights.get(stop.light)? {
                LightState::Red => braking_m(self.idm.emergency_deceleration_mps2),
                LightState::Yellow => braking_m(self.idm.deceleration_mps2),
                LightState::Green | LightState::Unknown => return None,
            };
            (gap_m >= 0.0 && gap_m >= needed_m).then_some(gap_m)
        })
    }

    /// Fills in the agents that are present at a tick, sorted by id.
    pub(crate) fn show(&self, scene: &Scene, tick: Tick, out: &mut Vec<AgentState>) {
        out.clear();
        let last = scene.last_tick();
        for (index, (track, motion)) in scene.tracks.iter().zip(&self.motions).enumerate() {
            let Ok(id) = u32::try_from(index) else { break };
            let place = match (motion, &self.paths[index]) {
                (Motion::Replay, _) => track.at(tick.min(last)).map(|point| {
                    // After the log everything stands where it was last seen.
                    let velocity_mps = if tick > last { DVec2::ZERO } else { point.velocity_mps };
                    TrackPoint { velocity_mps, ..*point }
                }),
                (Motion::Following { along_m, speed_mps }, Some(path)) => {
                    let knot = path.at(*along_m);
                    let velocity_mps = path.direction_at(*along_m) * *speed_mps;
                    Some(TrackPoint { pose: knot.pose, z_m: knot.z_m, velocity_mps })
                }
                (Motion::Following { .. } | Motion::Gone, _) => None,
            };
            if let Some(TrackPoint { pose, z_m, velocity_mps }) = place {
                out.push(AgentState { id: AgentId(id), class: track.class, size: track.size, pose, z_m, velocity_mps });
            }
        }
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

/// The ego as followers see it: its centre, its velocity in the world and its size.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Obstructing {
    pub(crate) centre: ds_space::PoseSe2,
    pub(crate) velocity_mps: DVec2,
    pub(crate) size: ds_world::Size,
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

//! What agents decide beyond following: lane changes, yielding, stepping on the road; and where the road differs from
//! the map. Everything is decided from one world state, so that order never matters; all of it is absent by default.

use std::sync::Arc;

use ds_effect::plant::{Agents, Chart, Plant};
use ds_space::{Draws, Tick};
use ds_world::{AgentClass, LightState, Scene, WorldState};

use crate::agent_path::AgentPath;
use crate::conflict::{self, Placed, Zone};
use crate::lane_change::{LANE_M, Lanes, Weave};
use crate::lane_index::LaneIndex;
use crate::participant::{Motion, Obstructing};
use crate::signal::SignalStop;
use crate::track_paths::TrackPaths;

/// Share of drivers in the last mapped lane who use the one beyond it, where there is one.
const BEYOND_SHARE: f64 = 0.5;

/// What all agents of a scene decide.
#[derive(Debug, Clone)]
pub(crate) struct Habits {
    pub(crate) agents: Agents,
    /// Shared by all copies.
    ways: Arc<TrackPaths>,
    /// How far each keeps to the left of its path.
    shifts_m: Arc<[f64]>,
    /// Who never yields.
    stubborn: Arc<[bool]>,
    weaves: Vec<Weave>,
    /// Where everybody is on their path now, the ego last.
    places: Vec<Option<Placed>>,
}

impl Habits {
    /// Draws what each agent is like.
    pub(crate) fn new(scene: &Scene, ways: Arc<TrackPaths>, plant: &Plant) -> Self {
        let (agents, tracks) = (plant.agents, scene.tracks.len());
        let shifts_m = if plant.chart == Chart::default() {
            Vec::new()
        } else {
            let index = LaneIndex::new(&scene.map);
            (0..tracks)
                .map(|track| {
                    ways.paths[track].as_ref().map_or(0.0, |path| shift_m(scene, track, path, &index, &plant.chart))
                })
                .collect()
        };
        let stubborn = |track: usize| {
            let draws = Draws::new(&scene.digest, "non-yielding", &[track as u64]);
            draws.uniform(0) < agents.non_yielding
        };
        Self {
            ways,
            shifts_m: shifts_m.into(),
            stubborn: (0..tracks).map(|track| agents.non_yielding > 0.0 && stubborn(track)).collect(),
            weaves: if agents.changes_lanes { vec![Weave::default(); tracks] } else { Vec::new() },
            places: Vec::new(),
            agents,
        }
    }

    /// Returns the state of all lane changes as numbers; nothing where nobody changes lanes.
    pub(crate) fn weaves(&self) -> Vec<[f64; 3]> {
        self.weaves.iter().map(|weave| weave.to_array()).collect()
    }

    /// Takes over the state of all lane changes, or names the first number that is none.
    pub(crate) fn set_weaves(&mut self, rows: &[[f64; 3]]) -> Result<(), (&'static str, f64)> {
        if rows.len() != self.weaves.len() {
            return Err(("agent.weaves", rows.len() as f64));
        }
        for (weave, row) in self.weaves.iter_mut().zip(rows) {
            *weave = Weave::from_array(*row).ok_or(("agent.weave", row[2]))?;
        }
        Ok(())
    }

    /// Returns how far an agent is to the left of its path, and its speed to the left.
    pub(crate) fn aside(&self, agent: usize, along_m: f64, speed_mps: f64) -> (f64, f64) {
        let shift_m = self.shift_m(agent);
        match (self.weaves.get(agent), self.ways.lanes.get(agent)) {
            (Some(weave), Some(lanes)) => {
                let (offset_m, aside_mps) = weave.place(lanes, along_m, speed_mps);
                (offset_m + shift_m, aside_mps)
            }
            _ => (shift_m, 0.0),
        }
    }

    /// Returns how far an agent keeps to the left of where the map has its lane.
    pub(crate) fn shift_m(&self, agent: usize) -> f64 {
        self.shifts_m.get(agent).copied().unwrap_or(0.0)
    }

    /// Returns where an agent will be when its lane change is done, if it is under way.
    pub(crate) fn target_m(&self, agent: usize, along_m: f64) -> Option<f64> {
        let (weave, lanes) = (self.weaves.get(agent)?, self.ways.lanes.get(agent)?);
        let target_m = || lanes.offset_m(weave.slot(), along_m).unwrap_or(LANE_M * f64::from(weave.slot()));
        weave.busy().then(|| target_m() + self.shift_m(agent))
    }

    /// Returns the lane change of an agent and its lanes, where agents change lanes.
    pub(crate) fn weave(&self, agent: usize) -> Option<(Weave, &Lanes)> {
        Some((*self.weaves.get(agent)?, self.ways.lanes.get(agent)?))
    }

    /// Goes on with an agent's lane change, or begins one.
    pub(crate) fn go_on(&mut self, agent: usize, wanted: Option<i8>, speed_mps: f64, dt_secs: f64) {
        if let Some(weave) = self.weaves.get_mut(agent) {
            weave.advance(wanted, speed_mps, dt_secs);
        }
    }

    /// Finds out where everybody is on their path.
    pub(crate) fn place(&mut self, world: &WorldState, ego: Obstructing, motions: &[Motion]) {
        let TrackPaths { paths, stops, ego: ego_path, .. } = &*self.ways;
        if self.ways.zones.is_empty() {
            return;
        }
        self.places.clear();
        self.places.resize(motions.len() + 1, None);
        for agent in &world.agents {
            let index = agent.id.0 as usize;
            let Some(path) = &paths[index] else { continue };
            let (along_m, speed_mps) = match motions[index] {
                Motion::Following { along_m, speed_mps } => (along_m, speed_mps),
                Motion::Replay => {
                    let Some(along_m) = path.along_at(world.tick.min(Tick(path.last_tick()))) else { continue };
                    (along_m, agent.velocity_mps.dot(path.direction_at(along_m)))
                }
                Motion::Gone => continue,
            };
            let half_length_m = 0.5 * agent.size.length_m;
            let red = |stop: &&SignalStop| world.lights.get(stop.light) == Some(&LightState::Red);
            let ahead = stops[index].iter().filter(|stop| stop.along_m > along_m + half_length_m);
            let held_before_m = ahead.filter(red).map(|stop| stop.along_m).fold(f64::INFINITY, f64::min);
            self.places[index] = Some(Placed { along_m, speed_mps, half_length_m, held_before_m });
        }
        if let Some(path) = ego_path {
            let near = path.stretch(0.0, path.length_m()).nearest(ego.centre.position);
            self.places[motions.len()] = Some(Placed {
                along_m: near.along_m,
                speed_mps: ego.velocity_mps.dot(near.direction),
                half_length_m: 0.5 * ego.size.length_m,
                held_before_m: f64::INFINITY,
            });
        }
    }

    /// Returns the way to the nearest zone at which a vehicle waits now.
    pub(crate) fn wait_ahead(&self, agent: usize, accel_mps2: f64) -> Option<f64> {
        if !self.agents.yields || self.stubborn.get(agent) == Some(&true) {
            return None;
        }
        let me = self.places.get(agent)?.as_ref()?;
        let zones = self.ways.zones.get(agent)?.iter();
        let waits = zones.filter_map(|zone| conflict::wait_ahead(me, zone, self.other(zone), accel_mps2));
        waits.min_by(f64::total_cmp)
    }

    /// Tells whether somebody on foot waits for a vehicle now.
    pub(crate) fn lets_pass(&self, agent: usize, pace_mps: f64) -> bool {
        let (Some(Some(me)), Some(zones)) = (self.places.get(agent), self.ways.zones.get(agent)) else { return false };
        let gap_secs = self.agents.walking_gap_secs;
        zones.iter().any(|zone| conflict::lets_pass(me, zone, self.other(zone), gap_secs, pace_mps))
    }

    fn other(&self, zone: &Zone) -> Option<&Placed> {
        self.places.get(zone.other)?.as_ref()
    }
}

fn shift_m(scene: &Scene, track: usize, path: &AgentPath, index: &LaneIndex<'_>, chart: &Chart) -> f64 {
    if scene.tracks[track].class == AgentClass::Pedestrian {
        return 0.0;
    }
    let mut shift_m = chart.lane_offset_m;
    if chart.lane_missing {
        let draws = Draws::new(&scene.digest, "missing lane", &[track as u64]);
        let (at, direction) = (path.at(0.0).pose.position, path.direction_at(0.0));
        let own = index.lane_at(at, direction);
        let right = index.lane_at(at - direction.perp() * LANE_M, direction);
        let last = own.is_some_and(|(lane, _)| right.is_none_or(|(other, _)| other == lane));
        if last && draws.uniform(0) < BEYOND_SHARE {
            shift_m -= LANE_M;
        }
    }
    shift_m
}

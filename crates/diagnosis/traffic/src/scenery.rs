//! Everything of a recording that does not depend on what is fitted: where each agent is along and beside its path, who
//! is ahead of it, where all stand at the zones in which they meet, what the lights show.
//!
//! Paths are those of the nominal simulator (the scene's own tracks). Metres along and to the left of a path.

use ds_effect::plant::{Agents, Chart};
use ds_sim::{AgentPath, Placed, TrackPaths, Zone};
use ds_space::plane::Polyline;
use ds_space::{DVec2, Tick};
use ds_world::{AgentClass, LightState, Map};

use crate::case::{Agent, Case, Recording, Seen};

/// Who is ahead counts up to this distance.
const REACH_M: f64 = 120.0;
/// Half of the least time that an agent must be seen for, s.
const SHORTEST_SECS: f64 = 6.0;
/// A lane is followed by whoever heads within 45° of it, at most so far from its centre.
const BESIDE_M: f64 = 6.0;

/// Somebody ahead of an agent on its path.
#[derive(Debug, Clone, Copy)]
pub struct Ahead {
    /// Centre along the path, m.
    pub centre_m: f64,
    /// Rear bumper along the path, m.
    pub rear_m: f64,
    /// Along the path, m/s.
    pub speed_mps: f64,
}

/// An agent at one tick.
#[derive(Debug, Clone)]
pub struct Mark {
    /// Along its path, m.
    pub along_m: f64,
    /// To the left of its path, m.
    pub lateral_m: f64,
    /// Along its path, m/s.
    pub speed_mps: f64,
    /// To the left of the nearest lane that runs its way, m.
    pub beside_lane_m: Option<f64>,
    /// Those ahead in its corridor, nearest first.
    pub ahead: Vec<Ahead>,
}

/// An agent that is judged.
#[derive(Debug, Clone)]
pub struct Actor {
    /// Recording.
    pub recording: usize,
    /// Place among its agents.
    pub index: usize,
    /// Its class.
    pub class: AgentClass,
    /// Half its length, m.
    pub half_length_m: f64,
    /// Half its width, m.
    pub half_width_m: f64,
    /// Where it is, tick by tick.
    pub marks: Vec<Option<Mark>>,
}

/// A recording made ready.
pub struct Scenery {
    /// Paths, stops, lanes and zones.
    pub ways: TrackPaths,
    /// Zones if every place where people cross were a crosswalk.
    pub unmarked: Vec<Vec<Zone>>,
    /// What the lights show, tick by tick.
    pub lights: Vec<Vec<LightState>>,
    /// Where everybody is on their path, tick by tick, the ego last.
    pub places: Vec<Vec<Option<Placed>>>,
    /// Time between ticks, s.
    pub dt_secs: f64,
    /// First tick that is judged.
    pub from_tick: usize,
    /// Whether the agents were recorded apart from the scene's own tracks.
    pub expected: bool,
}

/// Makes all recordings of a case ready and finds the agents to judge.
#[must_use]
pub fn prepare(case: &Case) -> (Vec<Scenery>, Vec<Actor>) {
    let mut sceneries = Vec::new();
    let mut actors = Vec::new();
    for (index, recording) in case.recordings.iter().enumerate() {
        let scenery = Scenery::new(recording, case.nominal.interactive);
        actors.extend(scenery.actors(recording, index));
        sceneries.push(scenery);
    }
    (sceneries, actors)
}

impl Scenery {
    fn new(recording: &Recording, interactive: bool) -> Self {
        let agents = Agents { changes_lanes: interactive, yields: true, walks: interactive, ..Agents::default() };
        let ways = TrackPaths::new(&recording.scene, &agents, &Chart::default());
        let unmarked = ways.meetings(&recording.scene, true);
        let ticks = recording.ticks();
        let heads = &recording.scene.map.traffic_lights;
        let lights: Vec<Vec<LightState>> =
            (0u32..).take(ticks).map(|tick| heads.iter().map(|head| head.at(Tick(tick))).collect()).collect();
        let mut scenery = Self {
            unmarked,
            lights,
            places: Vec::new(),
            dt_secs: recording.dt_secs,
            from_tick: recording.from_tick,
            expected: recording.expected,
            ways,
        };
        scenery.places = (0..ticks).map(|tick| scenery.placed(recording, tick)).collect();
        scenery
    }

    fn placed(&self, recording: &Recording, tick: usize) -> Vec<Option<Placed>> {
        let place = |(index, agent): (usize, &Agent)| {
            let path = if index == recording.ego() { self.ways.ego.as_ref() } else { self.ways.paths[index].as_ref() };
            let (path, seen) = (path?, agent.seen[tick]?);
            let [along_m, _] = path.project(seen.at);
            let nose_m = along_m + agent.half_length_m;
            let stops = self.ways.stops.get(index).map(Vec::as_slice).unwrap_or_default();
            let red = |light: usize| self.lights[tick].get(light) == Some(&LightState::Red);
            let held = stops.iter().filter(|stop| stop.along_m > nose_m && red(stop.light));
            Some(Placed {
                along_m,
                speed_mps: along_path(path, along_m, &seen),
                half_length_m: agent.half_length_m,
                held_before_m: held.map(|stop| stop.along_m).fold(f64::INFINITY, f64::min),
            })
        };
        recording.agents.iter().enumerate().map(place).collect()
    }

    fn actors(&self, recording: &Recording, number: usize) -> Vec<Actor> {
        let lanes = lanes(&recording.scene.map);
        let least = (SHORTEST_SECS / self.dt_secs) as usize;
        let judged = |(index, agent): (usize, &Agent)| {
            let path = self.ways.paths.get(index)?.as_ref()?;
            if agent.seen.iter().flatten().count() < least {
                return None;
            }
            let marks = (0..agent.seen.len()).map(|tick| mark(recording, index, agent, path, tick, &lanes)).collect();
            Some(Actor {
                recording: number,
                index,
                class: agent.class,
                half_length_m: agent.half_length_m,
                half_width_m: agent.half_width_m,
                marks,
            })
        };
        recording.agents.iter().enumerate().filter_map(judged).collect()
    }
}

fn along_path(path: &AgentPath, along_m: f64, seen: &Seen) -> f64 {
    seen.speed_mps * DVec2::from_angle(seen.heading_rad).dot(path.direction_at(along_m))
}

fn mark(
    recording: &Recording,
    index: usize,
    agent: &Agent,
    path: &AgentPath,
    tick: usize,
    lanes: &[Polyline],
) -> Option<Mark> {
    let seen = agent.seen[tick]?;
    let [along_m, lateral_m] = path.project(seen.at);
    let mut ahead = Vec::new();
    let near_m = REACH_M.min(20.0 + 6.0 * seen.speed_mps.abs());
    for (_, who) in recording.agents.iter().enumerate().filter(|(other, _)| *other != index) {
        let Some(there) = who.seen[tick] else { continue };
        if who.class.is_static() || there.at.distance(seen.at) > near_m {
            continue;
        }
        let [centre_m, aside_m] = path.project(there.at);
        let direction = path.direction_at(centre_m);
        let forward = DVec2::from_angle(there.heading_rad);
        let (along, across) = (direction.dot(forward).abs(), direction.perp_dot(forward).abs());
        let across_m = across * who.half_length_m + along * who.half_width_m;
        if centre_m > along_m - 1.0 && (aside_m - lateral_m).abs() < across_m + agent.half_width_m {
            let rear_m = centre_m - along * who.half_length_m - across * who.half_width_m;
            ahead.push(Ahead { centre_m, rear_m, speed_mps: there.speed_mps * direction.dot(forward) });
        }
    }
    ahead.sort_by(|a, b| a.rear_m.total_cmp(&b.rear_m));
    ahead.truncate(3);
    let beside_lane_m = beside(lanes, &seen);
    Some(Mark { along_m, lateral_m, speed_mps: along_path(path, along_m, &seen), beside_lane_m, ahead })
}

fn lanes(map: &Map) -> Vec<Polyline> {
    map.lanes.iter().filter_map(|lane| Polyline::new(&lane.centre_line)).collect()
}

/// Returns how far somebody is to the left of the nearest lane that runs its way.
fn beside(lanes: &[Polyline], seen: &Seen) -> Option<f64> {
    let forward = DVec2::from_angle(seen.heading_rad);
    let mut best: Option<f64> = None;
    for lane in lanes {
        let near = lane.project(seen.at);
        let inside = near.along_m > 0.0 && near.along_m < lane.length_m();
        let aligned = lane.direction(near.segment).dot(forward) > std::f64::consts::FRAC_1_SQRT_2;
        if inside
            && aligned
            && near.distance_m < BESIDE_M
            && best.is_none_or(|least| near.lateral_m.abs() < least.abs())
        {
            best = Some(near.lateral_m);
        }
    }
    best
}

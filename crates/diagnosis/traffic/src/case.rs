//! Reads a case of recorded traffic: `meta.json` with `"model": "traffic"`, a scene per recording, and the tracks of the
//! agents in it, as a table or as logged in the scene itself.
//!
//! A table has the columns t (s), id (index of the scene's track; -1 is the vehicle that recorded), x, y (m, centre),
//! yaw (rad), v (m/s). World frame of the scene. Tracks are smoothed by local straight lines over 0.9 s.

use std::path::Path;
use std::sync::Arc;

use ds_diagnosis::CaseError;
use ds_diagnosis::meta::{Drivers, TrafficMeta};
use ds_sim::IdmParameters;
use ds_space::{DVec2, Tick};
use ds_world::{AgentClass, Scene};

use crate::error::TrafficError;

/// Samples to either side over which a track is smoothed.
const REACH: usize = 4;

/// The nominal simulator of the agents.
#[derive(Debug, Clone, Copy)]
pub struct Nominal {
    headway: f64,
    min_gap: f64,
    max_accel: f64,
    comfort_decel: f64,
    desired_speed: Option<f64>,
    /// Whether its agents change lanes, yield and walk by themselves.
    pub interactive: bool,
}

impl From<&Drivers> for Nominal {
    fn from(drivers: &Drivers) -> Self {
        let idm = IdmParameters::default();
        Self {
            headway: drivers.headway.unwrap_or(idm.headway_secs),
            min_gap: drivers.min_gap.unwrap_or(idm.minimum_gap_m),
            max_accel: drivers.max_accel.unwrap_or(idm.acceleration_mps2),
            comfort_decel: drivers.comfort_decel.unwrap_or(idm.deceleration_mps2),
            desired_speed: drivers.desired_speed,
            interactive: drivers.interactive.unwrap_or(true),
        }
    }
}

impl Nominal {
    /// Returns how its drivers follow.
    #[must_use]
    pub fn idm(&self) -> IdmParameters {
        IdmParameters {
            desired_speed_mps: self.desired_speed,
            minimum_gap_m: self.min_gap,
            headway_secs: self.headway,
            acceleration_mps2: self.max_accel,
            deceleration_mps2: self.comfort_decel,
            ..IdmParameters::default()
        }
    }

    fn check(&self) -> Result<(), TrafficError> {
        let desired = self.desired_speed.unwrap_or(10.0);
        for (field, value, low, high, need) in [
            ("nominal.headway", self.headway, 0.1, 10.0, "0.1 to 10 s"),
            ("nominal.min_gap", self.min_gap, 0.0, 20.0, "0 to 20 m"),
            ("nominal.max_accel", self.max_accel, 0.1, 10.0, "0.1 to 10 m/s2"),
            ("nominal.comfort_decel", self.comfort_decel, 0.1, 10.0, "0.1 to 10 m/s2"),
            ("nominal.desired_speed", desired, 0.5, 60.0, "0.5 to 60 m/s"),
        ] {
            if !(low..=high).contains(&value) {
                return Err(TrafficError::Field { field, value, need });
            }
        }
        Ok(())
    }
}

/// A road user at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Centre.
    pub at: DVec2,
    /// Heading, rad.
    pub heading_rad: f64,
    /// Speed along the heading, m/s.
    pub speed_mps: f64,
}

/// A recorded road user; the place in its recording is that of its track in the scene, the ego being last.
#[derive(Debug, Clone)]
pub struct Agent {
    /// Its class.
    pub class: AgentClass,
    /// Half its length, m.
    pub half_length_m: f64,
    /// Half its width, m.
    pub half_width_m: f64,
    /// What was seen of it, one entry per tick.
    pub seen: Vec<Option<Seen>>,
}

/// A recording with its scene.
#[derive(Debug, Clone)]
pub struct Recording {
    /// The scene's name.
    pub name: String,
    /// The scene; its tracks are what the nominal simulator starts from.
    pub scene: Arc<Scene>,
    /// Time between ticks, s.
    pub dt_secs: f64,
    /// The agents, the ego last.
    pub agents: Vec<Agent>,
    /// Whether the agents were recorded apart from the scene, whose own tracks are then what was expected of them.
    pub expected: bool,
    /// First tick that is judged.
    pub from_tick: usize,
}

/// A case.
#[derive(Debug, Clone)]
pub struct Case {
    /// Its name.
    pub name: String,
    /// The recordings.
    pub recordings: Vec<Recording>,
    /// The nominal simulator.
    pub nominal: Nominal,
    /// Recordings kept from the fit.
    pub held_out: Vec<usize>,
    /// What looked odd.
    pub warnings: Vec<String>,
}

impl Case {
    /// Reads a case folder.
    ///
    /// # Errors
    /// If a file is missing, spoiled or absurd.
    pub fn read(folder: &Path) -> Result<Self, TrafficError> {
        let meta = TrafficMeta::read(folder)?;
        let nominal = Nominal::from(&meta.nominal);
        nominal.check()?;
        let mut recordings = Vec::new();
        let mut warnings = Vec::new();
        for entry in &meta.recordings {
            let (scene, _) = ds_scenario::load(&folder.join(&entry.scene))?;
            let table = entry.tracks.as_ref().map(|tracks| folder.join(tracks));
            let recording = Recording::new(Arc::new(scene), table.as_deref(), entry.from_secs, &mut warnings)?;
            recordings.push(recording);
        }
        let count = recordings.len();
        let mut held_out = meta.suggested_split.map(|split| split.held_out).unwrap_or_default();
        held_out.retain(|index| *index < count);
        if held_out.is_empty() && count > 2 {
            held_out = (0..count).filter(|index| index % 4 == 3 || *index == count - 1).collect();
        }
        Ok(Self { name: meta.case, recordings, nominal, held_out, warnings })
    }
}

impl Recording {
    fn new(
        scene: Arc<Scene>,
        table: Option<&Path>,
        from_secs: f64,
        warnings: &mut Vec<String>,
    ) -> Result<Self, TrafficError> {
        let dt_secs = scene.dt.secs();
        let ticks = scene.ego_log.len();
        let ego = scene.vehicle.size;
        let empty = |class, length_m: f64, width_m: f64| Agent {
            class,
            half_length_m: 0.5 * length_m,
            half_width_m: 0.5 * width_m,
            seen: vec![None; ticks],
        };
        let mut agents: Vec<Agent> =
            scene.tracks.iter().map(|track| empty(track.class, track.size.length_m, track.size.width_m)).collect();
        agents.push(empty(AgentClass::Vehicle, ego.length_m, ego.width_m));
        match table {
            Some(path) => fill(&mut agents, path, dt_secs, warnings)?,
            None => logged(&mut agents, &scene),
        }
        for agent in &mut agents {
            agent.seen = smooth(&agent.seen, dt_secs);
        }
        let from_tick = (from_secs / dt_secs).max(0.0) as usize;
        Ok(Self { name: scene.name.clone(), scene, dt_secs, agents, expected: table.is_some(), from_tick })
    }

    /// Returns how many ticks it has.
    #[must_use]
    pub fn ticks(&self) -> usize {
        self.agents.iter().map(|agent| agent.seen.len()).max().unwrap_or(0)
    }

    /// Returns the place of the ego among the agents.
    #[must_use]
    pub fn ego(&self) -> usize {
        self.agents.len() - 1
    }
}

fn logged(agents: &mut [Agent], scene: &Scene) {
    let ticks = scene.ego_log.len();
    for tick in 0..ticks {
        let Ok(at) = u32::try_from(tick) else { break };
        for (track, agent) in scene.tracks.iter().zip(agents.iter_mut()) {
            agent.seen[tick] = track.at(Tick(at)).map(|point| Seen {
                at: point.pose.position,
                heading_rad: point.pose.heading_rad,
                speed_mps: point.velocity_mps.dot(point.pose.forward()),
            });
        }
        let ego = scene.logged_ego(Tick(at));
        let centre = ego.centre(&scene.vehicle);
        if let Some(agent) = agents.last_mut() {
            let speed_mps = ego.speed_mps();
            agent.seen[tick] = Some(Seen { at: centre.position, heading_rad: centre.heading_rad, speed_mps });
        }
    }
}

fn fill(agents: &mut [Agent], path: &Path, dt_secs: f64, warnings: &mut Vec<String>) -> Result<(), TrafficError> {
    let text = std::fs::read_to_string(path).map_err(|source| CaseError::Read { path: path.to_path_buf(), source })?;
    let mut lines = text.lines();
    let head: Vec<&str> = lines.next().unwrap_or_default().split(',').map(str::trim).collect();
    let columns = ["t", "id", "x", "y", "yaw", "v"];
    let mut places = [0; 6];
    for (place, column) in places.iter_mut().zip(columns) {
        let found = head.iter().position(|name| *name == column);
        *place = found.ok_or_else(|| TrafficError::Column { column, path: path.to_path_buf() })?;
    }
    let mut strangers = 0;
    for (row, line) in lines.enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let cells: Vec<&str> = line.split(',').collect();
        let mut values = [0.0; 6];
        for ((value, place), column) in values.iter_mut().zip(places).zip(columns) {
            let cell = cells.get(place).copied().unwrap_or_default().trim();
            *value = cell.parse::<f64>().ok().filter(|number| number.abs() < 1e7).ok_or_else(|| {
                TrafficError::Cell { row: row + 1, column, value: cell.to_owned(), path: path.to_path_buf() }
            })?;
        }
        let [t, id, x, y, heading_rad, speed_mps] = values;
        let tick = (t / dt_secs).round();
        let index = if id < 0.0 { agents.len() - 1 } else { id as usize };
        if index >= agents.len() || !(0.0..1e6).contains(&tick) {
            strangers += 1;
            continue;
        }
        let seen = &mut agents[index].seen;
        let tick = tick as usize;
        if tick >= seen.len() {
            seen.resize(tick + 1, None);
        }
        seen[tick] = Some(Seen { at: DVec2::new(x, y), heading_rad, speed_mps });
    }
    if strangers > 0 {
        warnings.push(format!("{strangers} rows are of nobody in the scene: {}", path.display()));
    }
    let ticks = agents.iter().map(|agent| agent.seen.len()).max().unwrap_or(0);
    agents.iter_mut().for_each(|agent| agent.seen.resize(ticks, None));
    Ok(())
}

/// Replaces each sample by the middle of a straight line through its neighbours; stretches without a gap only.
fn smooth(seen: &[Option<Seen>], dt_secs: f64) -> Vec<Option<Seen>> {
    let line = |k: usize| -> Option<Seen> {
        let here = seen[k]?;
        let left = (1..=REACH).take_while(|n| *n <= k && seen[k - n].is_some()).count();
        let right = (1..=REACH).take_while(|n| seen.get(k + n).is_some_and(Option::is_some)).count();
        let reach = left.min(right);
        if reach == 0 {
            return Some(here);
        }
        let (mut at, mut speed, mut count) = (DVec2::ZERO, 0.0, 0.0);
        let (mut cos, mut sin, mut slope, mut weight) = (0.0, 0.0, DVec2::ZERO, 0.0);
        for near in seen[k - reach..=k + reach].iter().flatten() {
            at += near.at;
            speed += near.speed_mps;
            cos += near.heading_rad.cos();
            sin += near.heading_rad.sin();
            count += 1.0;
        }
        for n in 1..=reach {
            if let (Some(before), Some(after)) = (seen[k - n], seen[k + n]) {
                let steps = n as f64;
                slope += (after.at - before.at) * steps;
                weight += 2.0 * steps * steps * dt_secs;
            }
        }
        let heading_rad = f64::atan2(sin, cos);
        // The slope of positions and the mean of measured speeds are two looks at the same speed.
        let moved_mps = (slope / weight).dot(DVec2::from_angle(heading_rad));
        Some(Seen { at: at / count, heading_rad, speed_mps: 0.3 * moved_mps + 0.7 * speed / count })
    };
    (0..seen.len()).map(line).collect()
}

//! A scenario as a value: all that an episode starts from.

use ds_space::{AgentId, CameraModel, DVec2, Digest, SimTime, Tick};

use crate::adversary::Adversary;
use crate::agent::{AgentState, Track};
use crate::ego::{EgoState, VehicleParameters};
use crate::map::Map;
use crate::state::WorldState;

/// What stands in a scenario's name between the recording and the road user that is its ego, where it was chosen.
pub const EGO_MARK: &str = "-ego";

/// The kind of situation that a scenario shows.
pub type Family = String;

/// Where a scenario comes from and under which terms it may be used.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Origin {
    /// The data set or generator, with its version or seed.
    pub source: String,
    /// The licence, as an SPDX expression where there is one.
    pub licence: String,
    /// Whom to name.
    pub attribution: String,
}

/// A loaded, validated scenario. The world frame is the file's; ticks are `dt` apart.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// The scenario's name, unique within its set; safe in file names.
    pub name: String,
    /// The family, such as `cut-in`; empty if imported.
    pub family: Family,
    /// Digest of the scenario's content: keys all random draws.
    pub digest: Digest,
    /// Time between ticks.
    pub dt: SimTime,
    /// The map.
    pub map: Map,
    /// The vehicle under test.
    pub vehicle: VehicleParameters,
    /// The logged drive of the expert, one state per tick (rear axle); defines the number of ticks.
    pub ego_log: Vec<EgoState>,
    /// The path to drive: a polyline in the world, in metres, from behind the start to past the end of the log.
    pub route: Vec<DVec2>,
    /// All other road users.
    pub tracks: Vec<Track>,
    /// The cameras of the rig.
    pub cameras: Vec<CameraModel>,
    /// What the drive looks like, in words, for the video model (weather, light, place).
    pub prompt: String,
    /// Where it comes from.
    pub origin: Origin,
    /// The road user that is meant to collide with the ego, if there is one.
    pub adversary: Option<Adversary>,
}

impl Scene {
    /// Returns the name of the recording: the scenario's, without who was chosen as its ego.
    ///
    /// Scenarios of one recording show the same road users at the same time.
    #[must_use]
    pub fn recording(&self) -> &str {
        let chosen = |id: &str| !id.is_empty() && id.chars().all(|c| c.is_ascii_digit());
        self.name.rsplit_once(EGO_MARK).filter(|(_, id)| chosen(id)).map_or(&self.name, |(name, _)| name)
    }

    /// Returns the last tick of the log.
    #[must_use]
    pub fn last_tick(&self) -> Tick {
        Tick(u32::try_from(self.ego_log.len().saturating_sub(1)).unwrap_or(u32::MAX))
    }

    /// Returns the logged ego state at a tick, the last one held.
    ///
    /// # Panics
    /// If the log is empty, which a validated scene never is.
    #[must_use]
    pub fn logged_ego(&self, tick: Tick) -> &EgoState {
        &self.ego_log[(tick.0 as usize).min(self.ego_log.len() - 1)]
    }

    /// Returns the world as logged at a tick: no simulation, no contacts.
    #[must_use]
    pub fn logged_world(&self, tick: Tick) -> WorldState {
        let seen = |(index, track): (u32, &Track)| {
            track.at(tick).map(|point| AgentState {
                id: AgentId(index),
                class: track.class,
                size: track.size,
                pose: point.pose,
                z_m: point.z_m,
                velocity_mps: point.velocity_mps,
            })
        };
        WorldState {
            tick,
            time: SimTime::at(tick, self.dt),
            ego: *self.logged_ego(tick),
            agents: (0..).zip(&self.tracks).filter_map(seen).collect(),
            lights: self.map.traffic_lights.iter().map(|light| light.at(tick)).collect(),
            contacts: Vec::new(),
        }
    }
}

//! The state of the whole world at one tick.

use ds_space::{AgentId, SimTime, Tick};

use crate::agent::AgentState;
use crate::ego::EgoState;
use crate::map::LightState;

/// With what the ego collided.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum ContactKind {
    /// Ego's front met the other.
    Front,
    /// Ego's side met the other.
    Side,
    /// Ego's rear was met.
    Rear,
}

/// A touch between the ego body and an agent at a tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// The other.
    pub agent: AgentId,
    /// Which part of the ego touched.
    pub kind: ContactKind,
    /// Whether ego is at fault (front contact, or contact with a standing agent).
    pub at_fault: bool,
    /// Speed of approach along the contact normal, in metres per second.
    pub closing_speed_mps: f64,
}

/// Ego, agents, lights and contacts at one tick; agents are sorted by id.
#[derive(Debug, Clone, PartialEq)]
pub struct WorldState {
    /// The tick.
    pub tick: Tick,
    /// The simulation time of the tick.
    pub time: SimTime,
    /// The ego vehicle.
    pub ego: EgoState,
    /// Agents present at this tick, sorted by id.
    pub agents: Vec<AgentState>,
    /// State of each traffic light of the map, in map order.
    pub lights: Vec<LightState>,
    /// Contacts of the ego at this tick, sorted by agent.
    pub contacts: Vec<Contact>,
}

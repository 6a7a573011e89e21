//! World state to next world state: ego dynamics under a tracked plan, log-replayed or reactive agents,
//! traffic lights of the log, contacts.
//!
//! Values in, values out: no clock, no files, no messages; the noise of a vehicle log is drawn by key and sample. World
//! frame, SI units, radians. Same scene, configuration and calls give the same bits; a [`Simulation::snapshot`] resumes
//! exactly. Effects of `ds_effect` change the car and the drivers that [`nominal`] describes; forces, followers and trackers
//! are those of `ds_vehicle`, integrated here.

mod actuation;
mod adversary;
mod agent_path;
mod conflict;
mod contact;
mod dynamics;
mod error;
mod escape;
mod habits;
mod hunting_ground;
mod lane_change;
mod lane_index;
mod participant;
mod readings;
mod route;
mod settings;
mod signal;
mod simulation;
mod snapshot;
mod track_paths;
mod traffic;

pub use agent_path::{AgentPath, Knot};
pub use conflict::{Duty, Placed, Zone, lets_pass, wait_ahead};
pub use ds_world::TrackerKind;
pub use error::{SimError, SnapshotError};
pub use lane_change::{Changer, Choice, Lanes, Neighbour, THRESHOLD_MPS2};
pub use readings::LOG_HZ;
pub use settings::{DynamicsKind, IdmScope, Manners, SimConfig};
pub use signal::{SignalStop, stop_ahead};
pub use simulation::Simulation;
pub use track_paths::TrackPaths;

pub use ds_vehicle::{IdmParameters, Lead, nominal};

//! World state to next world state: ego dynamics under a tracked plan, log-replayed or reactive agents,
//! traffic lights of the log, contacts.
//!
//! Values in, values out: no clock, no files, no messages; the noise of a vehicle log is drawn by key and sample. World
//! frame, SI units, radians. Same scene, configuration and calls give the same bits; a [`Simulation::snapshot`] resumes
//! exactly. Effects of `ds_effect` change the car and the drivers that [`nominal`] describes.

mod actuation;
mod agent_path;
mod banded;
mod conflict;
mod contact;
mod dynamics;
mod error;
mod habits;
mod idm;
mod lane_change;
mod lane_index;
mod lqr;
mod participant;
mod plant;
mod profile;
mod pursuit;
mod readings;
mod reference;
mod route;
mod settings;
mod signal;
mod simulation;
mod snapshot;
mod tracker;
mod traffic;
mod tyre;
mod ways;

pub use agent_path::{AgentPath, Knot};
pub use conflict::{Duty, Placed, Zone, lets_pass, wait_ahead};
pub use ds_world::TrackerKind;
pub use error::{SimError, SnapshotError};
pub use idm::{IdmParameters, Lead};
pub use lane_change::{Changer, Choice, Lanes, Neighbour, THRESHOLD_MPS2};
pub use plant::nominal;
pub use readings::LOG_HZ;
pub use settings::{DynamicsKind, IdmScope, Manners, SimConfig};
pub use signal::{SignalStop, stop_ahead};
pub use simulation::Simulation;
pub use ways::Ways;

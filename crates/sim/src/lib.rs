//! World state to next world state: ego dynamics under a tracked plan, log-replayed or reactive agents,
//! traffic lights of the log, contacts.
//!
//! Values in, values out: no clock, no files, no messages; the noise of a vehicle log is drawn by key and sample. World
//! frame, SI units, radians. Same scene, configuration and calls give the same bits; a [`Simulation::snapshot`] resumes
//! exactly. Effects of `ds_effect` change the car and the drivers that [`nominal`] describes.

mod actuation;
mod agent_path;
mod banded;
mod contact;
mod dynamics;
mod error;
mod idm;
mod lane_index;
mod lqr;
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

pub use error::{SimError, SnapshotError};
pub use idm::IdmParameters;
pub use plant::nominal;
pub use readings::LOG_HZ;
pub use settings::{AgentMode, DynamicsKind, IdmScope, SimConfig, TrackerKind};
pub use simulation::Simulation;

//! World state to next world state: ego dynamics under a tracked plan, log-replayed or reactive agents,
//! traffic lights of the log, contacts.
//!
//! Values in, values out: no clock, no files, no messages, no random draws. World frame, SI units, radians.
//! Same scene, configuration and calls give the same bits; a [`Simulation::snapshot`] resumes exactly.

mod agent_path;
mod banded;
mod contact;
mod dynamics;
mod error;
mod idm;
mod lane_index;
mod lqr;
mod profile;
mod pursuit;
mod reference;
mod route;
mod settings;
mod signal;
mod simulation;
mod snapshot;
mod tracker;
mod traffic;

pub use error::{SimError, SnapshotError};
pub use idm::IdmParameters;
pub use settings::{AgentMode, DynamicsKind, IdmScope, SimConfig, TrackerKind};
pub use simulation::Simulation;

//! Diagnoses the gap between recorded traffic and the agents and map of a simulator: where it lies, which effect on
//! agents or on the map of `ds_effect` causes it, how far it shrinks once that effect is added.
//!
//! [`diagnose()`] takes a case of recordings with their scenes and returns a [`ds_diagnosis::Diagnosis`]. The models are
//! those of `ds_sim`, run agent by agent among others as recorded. Method and limits: `docs/gap-traffic.md`.

pub mod case;
pub mod cells;
pub mod decide;
pub mod diagnose;
mod error;
pub mod how_far;
pub mod model;
pub mod rollout;
pub mod scenery;
pub mod search;
pub mod settings;
pub mod space;
pub mod synthetic;

pub use case::Case;
pub use diagnose::{Options, diagnose, evaluate};
pub use error::TrafficError;

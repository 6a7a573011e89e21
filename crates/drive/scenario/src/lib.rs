//! Scenario files: the versioned open format, the built-in families; prompts of drives.
//!
//! Everything ends as a checked [`ds_world::Scene`]; nothing here knows a message, a bus or a clock. The format is
//! described in `scenarios/README.md`.

mod compose;
mod content;
mod document;
mod facts;
pub mod family;
mod place;
mod pretty;
mod prompt;
mod resolve;
pub mod store;

pub use content::rounded;
pub use facts::{Ahead, EgoMotion, Facts, Geometry};
pub use family::{Family, UnknownFamily, generate, generate_set};
pub use place::Fault;
pub use prompt::prompt;
pub use resolve::{MAX_STATES, MAX_TICKS};
pub use store::{ScenarioError, Warning, checked, describe, list, load, parse, save, warnings};

//! Scenario files: the versioned open format, the importers of other logs, the built-in families; prompts of drives.
//!
//! Everything ends as a checked [`ds_world::Scene`]; nothing here knows a message, a bus or a clock. The format is
//! described in `scenarios/README.md`.

mod area;
mod compose;
mod content;
mod document;
mod facts;
pub mod family;
pub mod import;
mod path;
mod place;
mod pretty;
mod prompt;
mod resolve;
pub mod store;

pub use facts::{Ahead, EgoMotion, Facts, Geometry};
pub use family::{Family, UnknownFamily, generate, generate_set};
pub use import::{Format, ImportError, Imported, import_path};
pub use prompt::prompt;
pub use store::{ScenarioError, Warning, describe, list, load, parse, save};

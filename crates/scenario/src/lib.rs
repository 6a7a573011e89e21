//! Scenario files: the versioned open format, the importers of other logs, and the built-in families.
//!
//! Everything ends as a checked [`ds_world::Scene`]; nothing here knows a message, a bus or a clock.

mod area;
mod content;
pub mod family;
mod path;
pub mod store;

pub use family::{Family, UnknownFamily, generate, generate_set};
pub use store::{ScenarioError, save};

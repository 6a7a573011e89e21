//! Logs of any vehicle as cases of the practice schema: a mapping file says which column is which channel.
//!
//! [`Mapping::read`] takes the TOML file, [`Mapping::check`] looks for what is wrong with mapping or log and says so in
//! plain words with a proposed change, [`Mapping::case`] writes the folder that `ds_dynamics` takes. Worked example:
//! `docs/gap-real-logs.md`.

mod channel;
mod check;
mod command;
mod echo;
mod error;
mod export;
mod finding;
mod log;
mod mapping;
mod raw;
mod record;
mod resample;
mod stamps;
mod strata;
mod suggest;

pub use error::LogError;
pub use export::Imported;
pub use finding::LogFinding;
pub use mapping::Mapping;
pub use record::Record;
pub use suggest::{Suggestion, suggest};

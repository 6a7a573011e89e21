//! Importers of other logs. Each reads untrusted files as data and ends in the same checks as our own format.
//!
//! One file per log format; [`import_path`] takes a file or a folder and writes one scenario file for each log. What
//! takes scenarios and logs alike tells them apart by file or folder ([`files`], [`open`]).

pub mod argoverse2;
mod boundary;
pub mod commonroad;
mod error;
mod file;
mod format;
mod nuplan;
pub mod nuscenes;
pub mod openscene;
mod recorded;
pub mod scenarionet;
mod scene;
#[cfg(test)]
mod tests;
mod view;
#[cfg(test)]
#[path = "../../../base/pickle/tests/made/writer.rs"]
mod writer;

pub use ds_pickle::PickleError;
pub use error::ImportError;
pub use file::MAX_FILE_BYTES;
pub use format::{Choice, Format, Imported, files, import_path, open};
pub use nuplan::{GeometryError, MapError};
pub use recorded::Recorded;

//! Why a log cannot be imported.

use std::path::{Path, PathBuf};

use ds_pickle::PickleError;
use ds_scenario::ScenarioError;

use crate::nuplan::MapError;
use crate::view::FieldFault;

/// Says why a log cannot be imported.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The file or folder cannot be read.
    #[error("cannot read {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is over [`crate::MAX_FILE_BYTES`].
    #[error("log file has more than {limit} bytes: {}", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// The limit.
        limit: u64,
    },
    /// There is no log in the folder.
    #[error("no {wanted} in {}", path.display())]
    Empty {
        /// What is looked for.
        wanted: &'static str,
        /// The folder.
        path: PathBuf,
    },
    /// A log lacks a file.
    #[error("log has no {what}: {}", path.display())]
    Missing {
        /// The file, `*` standing for any text.
        what: String,
        /// The log.
        path: PathBuf,
    },
    /// A table is a parquet file.
    #[error("parquet is not read; write the table as CSV beside it: {command} {}", path.display())]
    Parquet {
        /// The file.
        path: PathBuf,
        /// The command that converts it.
        command: &'static str,
    },
    /// The pickle is refused.
    #[error("log refused: {}", path.display())]
    Pickle {
        /// The file.
        path: PathBuf,
        /// Why.
        source: PickleError,
    },
    /// A field is missing or holds something else than the format says.
    #[error("log refused: field {at:?} {problem} ({})", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// The path inside the log.
        at: String,
        /// What is wrong.
        problem: String,
    },
    /// The map of the log's city is refused.
    #[error("map refused: {}", path.display())]
    Map {
        /// The file.
        path: PathBuf,
        /// Why.
        source: MapError,
    },
    /// The scenario cannot be written.
    #[error("cannot save the imported scenario")]
    Save(#[from] ScenarioError),
    /// The scenario file is refused.
    #[error(transparent)]
    Load(ScenarioError),
}

impl ImportError {
    pub(crate) fn field(path: &Path, fault: FieldFault) -> Self {
        Self::Field { path: path.to_owned(), at: fault.at, problem: fault.problem }
    }
}

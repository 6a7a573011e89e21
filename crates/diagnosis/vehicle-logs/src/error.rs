//! Why a log cannot be turned into a case, by file, line and column.

use std::path::PathBuf;

use ds_diagnosis::CaseError;

use crate::finding::LogFinding;

/// A mapping or log that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// A file cannot be read or written, or is larger than any log.
    #[error(transparent)]
    Case(#[from] CaseError),
    /// A bag cannot be read, or does not hold what is mapped.
    #[error(transparent)]
    Bag(#[from] ds_bags::BagError),
    /// A folder is no bag, so that nothing can be proposed for it.
    #[error("no MCAP or rosbag2 files in folder {path:?} (of text files name one, and map all by its mapping)")]
    NoBag {
        /// The folder.
        path: PathBuf,
    },
    /// A text file is no table that a mapping could be of.
    #[error("{file:?} is no MCAP, ROS 1 bag or rosbag2 file, and no table to propose a mapping for: {why}")]
    NoTable {
        /// Why.
        why: String,
        /// The file.
        file: String,
    },
    /// A command has no message.
    #[error("no value of {what} in {file:?}; the simulator needs every command")]
    NoMessage {
        /// What was sought.
        what: String,
        /// The file.
        file: String,
    },
    /// The mapped channels were never recorded at the same time.
    #[error(
        "mapped channels of {file:?} have no stamps in common: {clocks:?} (if one clock is simulated, map stamp = \"log\" for all)"
    )]
    Apart {
        /// From when to when each was.
        clocks: Vec<String>,
        /// The file.
        file: String,
    },
    /// A command is a measurement.
    #[error("{0}")]
    Echo(LogFinding),
    /// The mapping is not such a file; the source names line and column.
    #[error("cannot understand mapping {path:?}")]
    Toml {
        /// The file.
        path: PathBuf,
        /// Why.
        source: Box<toml::de::Error>,
    },
    /// The mapping contradicts itself.
    #[error("mapping: {entry} {problem}")]
    Mapping {
        /// The entry, as a dotted key.
        entry: String,
        /// What is wrong with it.
        problem: String,
    },
    /// A column of the mapping is not in the log.
    #[error("no column {column:?} in {file:?}, which has {found:?}")]
    NoColumn {
        /// Column sought.
        column: String,
        /// Columns there are.
        found: Vec<String>,
        /// The file.
        file: String,
    },
    /// A cell is neither empty nor a number.
    #[error("not a number: {text:?} in line {line}, column {column} of {file:?}")]
    NotANumber {
        /// Line of the file, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// What stands there.
        text: String,
        /// The file.
        file: String,
    },
    /// A row has another number of cells than the head.
    #[error("line {line} has {cells} cells, expected {columns}, in {file:?}")]
    Ragged {
        /// Line of the file, from 1.
        line: usize,
        /// Cells found.
        cells: usize,
        /// Cells expected.
        columns: usize,
        /// The file.
        file: String,
    },
    /// Nothing usable is left of a log.
    #[error("no stretch of {secs} s with commands and motion in {file:?}")]
    Empty {
        /// Shortest stretch, s.
        secs: f64,
        /// The file.
        file: String,
    },
}

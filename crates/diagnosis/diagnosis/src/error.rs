//! Why a case cannot be diagnosed, by name, with the offending file and value.

use std::path::PathBuf;

/// A case that cannot be read or makes no sense.
#[derive(Debug, thiserror::Error)]
pub enum CaseError {
    /// A file of the case cannot be read.
    #[error("cannot read {path:?}")]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A report cannot be written.
    #[error("cannot write {path:?}")]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// `meta.json` or the labels are not what they should be.
    #[error("cannot understand {path:?}")]
    Json {
        /// The file.
        path: PathBuf,
        /// Why.
        source: serde_path_to_error::Error<serde_json::Error>,
    },
    /// A baseline file is not what it should be.
    #[error("cannot use baseline: {why}, in {path:?}")]
    Baseline {
        /// What is wrong.
        why: String,
        /// The file.
        path: PathBuf,
    },
    /// A baseline is of another vehicle or other channels.
    #[error("the baseline is not one for case {case:?}: {why}; make one of healthy logs of this vehicle")]
    OtherBaseline {
        /// What differs.
        why: String,
        /// The case.
        case: String,
    },
    /// There is no healthy log to learn from.
    #[error("no healthy log to learn a baseline from")]
    NoHealthy,
    /// A healthy log is given twice.
    #[error(
        "healthy logs {one:?} and {other:?} hold the same drive: two alike say nothing of what differs from log to log"
    )]
    SameLog {
        /// The one.
        one: String,
        /// The other.
        other: String,
    },
    /// A baseline says too little of single windows.
    #[error(
        "the baseline holds windows of {logs} healthy logs, a watch needs {least}: learn it again by `gap baseline` of this version"
    )]
    Unwatched {
        /// Logs there are.
        logs: usize,
        /// Logs needed.
        least: usize,
    },
    /// A fleet is too small for members to be told from the others.
    #[error("{members} members are too few to tell some from the others; {least} or more are needed (see --by)")]
    SmallFleet {
        /// Members there are.
        members: usize,
        /// Members needed.
        least: usize,
    },
    /// A case does not say which member of a fleet it is of.
    #[error("case {case:?} does not say of which {by} it is: meta.json needs {by:?}")]
    NoMember {
        /// The case.
        case: String,
        /// Field of `meta.json`.
        by: &'static str,
    },
    /// The nominal vehicle is not one that could drive.
    #[error("absurd nominal vehicle: {field} is {value:?}, expected {range}")]
    AbsurdVehicle {
        /// Field of `meta.json`.
        field: &'static str,
        /// Its value.
        value: f64,
        /// What would be believed.
        range: &'static str,
    },
    /// A log is larger than any real case.
    #[error("log too large: {what} in {file:?}, the limit is {limit}")]
    TooLarge {
        /// Rows, bytes, columns or seconds.
        what: &'static str,
        /// The limit.
        limit: usize,
        /// The file.
        file: String,
    },
    /// A column that must be there is not.
    #[error("missing column {column:?} in {file:?}")]
    MissingColumn {
        /// Name of the column.
        column: &'static str,
        /// The file.
        file: String,
    },
    /// A cell is not a number, or none that can be a measurement.
    #[error("not a number that can be: row {row} of column {column:?} is {text:?} in {file:?}")]
    NotANumber {
        /// Row below the head, from 1.
        row: usize,
        /// Column.
        column: String,
        /// What stands there.
        text: String,
        /// The file.
        file: String,
    },
    /// A row has more or fewer cells than the head.
    #[error("row {row} has {cells} cells, the head has {columns} in {file:?}")]
    RaggedRow {
        /// Row below the head, from 1.
        row: usize,
        /// Cells found.
        cells: usize,
        /// Columns expected.
        columns: usize,
        /// The file.
        file: String,
    },
    /// A drive has too few samples to start one window.
    #[error("drive too short: {samples} samples over {secs:.2} s in {file:?}, 6 s are needed")]
    TooShort {
        /// Samples found.
        samples: usize,
        /// Duration, s.
        secs: f64,
        /// The file.
        file: String,
    },
    /// Time stamps do not grow.
    #[error("time goes back: row {row} has t = {t} after {before} in {file:?}")]
    TimeGoesBack {
        /// Row below the head, from 1.
        row: usize,
        /// Stamp, s.
        t: f64,
        /// The stamp before, s.
        before: f64,
        /// The file.
        file: String,
    },
    /// Samples are missing for longer than can be bridged.
    #[error("gap of {secs:.2} s after t = {t} in {file:?}")]
    TimeGap {
        /// Length, s.
        secs: f64,
        /// Start, s.
        t: f64,
        /// The file.
        file: String,
    },
    /// A column has no value for longer than can be bridged.
    #[error(
        "column {column:?} has no value for {secs:.2} s after t = {t} in {file:?}; leave the column out, or cut the drive"
    )]
    ColumnGap {
        /// Column.
        column: String,
        /// Length, s.
        secs: f64,
        /// Start, s.
        t: f64,
        /// The file.
        file: String,
    },
    /// A channel never changes although the vehicle moves.
    #[error("channel {column:?} never changes in {file:?}")]
    ZeroVariance {
        /// Column.
        column: String,
        /// The file.
        file: String,
    },
    /// Values do not fit together; usually a wrong unit, sign or column.
    #[error("{file:?}: {finding}")]
    Inconsistent {
        /// What does not fit and what it looks like.
        finding: String,
        /// The file.
        file: String,
    },
    /// A description names what is not there, or twice what is once.
    #[error("meta.json of case {case:?} cannot be used: {why}")]
    Description {
        /// What is wrong, with the key.
        why: String,
        /// Name of the case.
        case: String,
    },
    /// No drive is left for the fit.
    #[error("no drive to fit in {case:?}")]
    NoDrive {
        /// Name of the case.
        case: String,
    },
}

//! Why a case of recorded traffic cannot be diagnosed.

use std::path::PathBuf;

use ds_diagnosis::CaseError;

/// Says what is wrong with a case.
#[derive(Debug, thiserror::Error)]
pub enum TrafficError {
    /// A file cannot be read, or `meta.json` is not what it should be.
    #[error(transparent)]
    Case(#[from] CaseError),
    /// A scene is refused.
    #[error("the scene of a recording is refused")]
    Scene(#[from] ds_scenario::ScenarioError),
    /// A table lacks a column.
    #[error("column {column:?} is missing: {}", path.display())]
    Column {
        /// The column.
        column: &'static str,
        /// The file.
        path: PathBuf,
    },
    /// A cell is no finite number.
    #[error("row {row}, column {column:?}: {value:?} is no finite number ({})", path.display())]
    Cell {
        /// The row, from 1.
        row: usize,
        /// The column.
        column: &'static str,
        /// What is there.
        value: String,
        /// The file.
        path: PathBuf,
    },
    /// A number of the description is out of range.
    #[error("field {field:?} is {value}, need {need}")]
    Field {
        /// The field.
        field: &'static str,
        /// Its value.
        value: f64,
        /// What is allowed.
        need: &'static str,
    },
    /// Nobody moves for long enough to be judged.
    #[error("nobody in case {case:?} is seen moving for {secs} s on end")]
    Nobody {
        /// The case.
        case: String,
        /// How long is needed, s.
        secs: f64,
    },
}

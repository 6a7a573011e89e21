//! Why a case has no answer: the file, the field, and what is wrong with it.

use std::path::PathBuf;

use ds_score::ScoreError;

use crate::fields::MAX_CASE_BYTES;

/// Says why a case or a folder of cases cannot be answered.
#[derive(Debug, thiserror::Error)]
pub enum ScoreCaseError {
    /// A folder or file cannot be read.
    #[error("reading failed at {path:?}")]
    Read {
        /// Where.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The folder holds no case file.
    #[error("no case file in {path:?}")]
    NoCases {
        /// Which folder.
        path: PathBuf,
    },
    /// A file is too large to be a case.
    #[error("{bytes} bytes are more than the {MAX_CASE_BYTES} of a case, at {path:?}")]
    TooLarge {
        /// Which file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
    },
    /// Two files answer to one name.
    #[error("case id {id:?} occurs twice, again at {path:?}")]
    Twice {
        /// The name.
        id: String,
        /// The second file.
        path: PathBuf,
    },
    /// A file is not JSON, or a field is missing or of another type.
    #[error("field {field:?} cannot be read")]
    Field {
        /// The path of the field inside the file; `.` is the whole file, `?` a place that is no JSON.
        field: String,
        /// What the reader says.
        source: serde_json::Error,
    },
    /// The schema is not one of the six.
    #[error("schema {schema:?} is not known")]
    Schema {
        /// The schema.
        schema: String,
    },
    /// A value is readable but means nothing here.
    #[error("field {field:?} has the value {value:?}, which is not known")]
    Value {
        /// Which field.
        field: String,
        /// Its value.
        value: String,
    },
    /// A list has another length than it must have.
    #[error("field {field:?} has {found} entries, {needed} are needed")]
    Length {
        /// Which field.
        field: String,
        /// How many there are.
        found: usize,
        /// How many there must be.
        needed: usize,
    },
    /// The case is readable but cannot be scored.
    #[error("case cannot be scored in {field:?}")]
    Score {
        /// The part of the case.
        field: String,
        /// What the score says.
        source: ScoreError,
    },
}

impl ScoreCaseError {
    /// Wraps a refusal of the score with the part of the case that it concerns.
    pub(crate) fn score(field: impl Into<String>) -> impl FnOnce(ScoreError) -> Self {
        move |source| Self::Score { field: field.into(), source }
    }
}

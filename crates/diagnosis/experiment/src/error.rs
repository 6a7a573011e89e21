//! Why no experiment can be designed or driven.

use ds_diagnosis::CaseError;

/// What is wrong.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// A limit of the envelope is none.
    #[error("envelope: {field} is {value}, expected {expected}")]
    Envelope {
        /// The field.
        field: &'static str,
        /// Its value.
        value: String,
        /// What it may be.
        expected: String,
    },
    /// Nothing that was designed stays within the envelope.
    #[error(
        "none of {tried} manoeuvres stays within the envelope in all of {draws} draws; the last left it by {worst}"
    )]
    NoneHolds {
        /// Manoeuvres that were drawn.
        tried: usize,
        /// Draws of each.
        draws: usize,
        /// Which limit was passed, and how far.
        worst: String,
    },
    /// Every manoeuvre of the library is left out.
    #[error("no manoeuvre is left to try")]
    NothingLeft,
    /// Who drives did not answer.
    #[error("the drive came to nothing: the simulator answered no finite motion")]
    NotDriven,
    /// The log of a run makes no sense.
    #[error("log of run {run}")]
    Log {
        /// Number of the run.
        run: usize,
        /// Why.
        source: CaseError,
    },
}

impl ExperimentError {
    /// Returns the error with what it comes of.
    pub(crate) fn in_words(&self) -> String {
        match self {
            Self::Log { source, .. } => format!("{self}: {source}"),
            _ => self.to_string(),
        }
    }
}

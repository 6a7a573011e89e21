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
        expected: &'static str,
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

//! What all diagnosers of the gap share: the description of a case and its tables, the diagnosis as a value and as JSON,
//! and the scoring of many diagnoses against their labels.
//!
//! A diagnoser reads a case of its kind and returns a [`Diagnosis`]; which kind that is says [`meta`]. Nothing is
//! diagnosed here. Schema and figures: `docs/gap-diagnosis.md`.

pub mod attended;
pub mod discovery;
mod error;
pub mod grid;
mod join;
pub mod json;
pub mod meta;
pub mod modulation;
mod null;
pub mod relation;
pub mod saved;
pub mod schema;
pub mod score;
pub mod table;
pub mod unevenness;
pub mod verdict;

pub use ds_effect::Verdict;
pub use error::CaseError;
pub use schema::Diagnosis;

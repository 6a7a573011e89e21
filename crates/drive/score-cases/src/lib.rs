//! Case files with reference answers in, this implementation's answers out: what `dreamstream score --cases` writes.
//!
//! Six schemas (`pdm_score/1`, `comfort/1`, `extended_comfort/1`, `collision_type/1`, `two_stage/1`,
//! `closed_loop_live/1`). An answer has the case's `expected…` keys in the same nesting. SI units, radians, world frame.
//! Nothing is compared here: whoever holds the expected values does that.

mod agents;
mod case;
mod closed_loop_live;
mod collision_type;
mod comfort;
mod error;
mod extended_comfort;
mod fields;
mod folder;
mod pdm_score;
mod pdm_score_answer;
mod two_stage;

pub use case::answer_case;
pub use error::ScoreCaseError;
pub use fields::MAX_CASE_BYTES;
pub use folder::{Answers, answer, answers};

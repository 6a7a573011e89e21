//! One case file: its schema decides who reads and answers it.

use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::error::ScoreCaseError;
use crate::{closed_loop_live, collision_type, comfort, extended_comfort, pdm_score_answer, two_stage};

#[derive(Deserialize)]
struct Head {
    schema: String,
    case_id: String,
}

/// Answers one case, given as the text of its file; returns its id and its answer.
///
/// # Errors
/// [`ScoreCaseError`] names the field that cannot be read or scored.
pub fn answer_case(text: &str) -> Result<(String, Value), ScoreCaseError> {
    let head: Head = parse(text)?;
    let answer = match head.schema.as_str() {
        "pdm_score/1" => pdm_score_answer::answer(&parse(text)?),
        "comfort/1" => comfort::answer(&parse(text)?),
        "extended_comfort/1" => extended_comfort::answer(&parse(text)?),
        "collision_type/1" => collision_type::answer(&parse(text)?),
        "two_stage/1" => two_stage::answer(&parse(text)?),
        "closed_loop_live/1" => closed_loop_live::answer(&parse(text)?),
        _ => Err(ScoreCaseError::Schema { schema: head.schema }),
    }?;
    Ok((head.case_id, answer))
}

fn parse<T: DeserializeOwned>(text: &str) -> Result<T, ScoreCaseError> {
    let mut reader = serde_json::Deserializer::from_str(text);
    serde_path_to_error::deserialize(&mut reader)
        .map_err(|error| ScoreCaseError::Field { field: error.path().to_string(), source: error.into_inner() })
}

//! `extended_comfort/1`: the executed states of two consecutive frames → EC and its root-mean-square differences.

use ds_score::{DIFFERENCE_NAMES, extended_comfort};
use serde::Deserialize;
use serde_json::{Map, Value, json};

use crate::error::ScoreCaseError;
use crate::fields::{Columns, states};

#[derive(Deserialize)]
pub(crate) struct Case {
    current_states: Vec<Columns>,
    previous_states: Vec<Columns>,
    shift_s: f64,
}

pub(crate) fn answer(case: &Case) -> Result<Value, ScoreCaseError> {
    let result = extended_comfort(&states(&case.current_states), &states(&case.previous_states), case.shift_s)
        .map_err(ScoreCaseError::score("current_states and previous_states"))?;
    let rms: Map<String, Value> =
        DIFFERENCE_NAMES.iter().zip(result.rms).map(|(name, value)| ((*name).to_owned(), json!(value))).collect();
    Ok(json!({ "expected": { "ec": result.score, "rms": rms } }))
}

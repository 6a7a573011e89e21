//! `comfort/1`: a series of states → its comfort features and whether they stay within their limits.

use ds_score::Footprint;
use ds_score::comfort::{ComfortFilters, ComfortRule, ComfortSeries, FEATURE_NAMES, within};
use ds_score::constants::horizon::DT_S;
use serde::Deserialize;
use serde_json::{Map, Value, json};

use crate::error::ScoreCaseError;
use crate::fields::{Columns, states};

#[derive(Deserialize)]
pub(crate) struct Case {
    dt: Option<f64>,
    states: Vec<Columns>,
}

pub(crate) fn answer(case: &Case) -> Result<Value, ScoreCaseError> {
    let filters = ComfortFilters::with_dt(case.states.len(), ComfortRule::Centre, case.dt.unwrap_or(DT_S))
        .map_err(ScoreCaseError::score("states"))?;
    let mut memory = ComfortSeries::default();
    let features = filters.features(&states(&case.states), Footprint::NAVSIM.rear_axle_to_centre_m, &mut memory);
    let within = within(features);
    let named: Map<String, Value> =
        FEATURE_NAMES.iter().zip(features).map(|(name, series)| ((*name).to_owned(), json!(series))).collect();
    Ok(json!({
        "expected": {
            "features": named,
            "order": FEATURE_NAMES,
            "within": within,
            "comfortable": within.iter().all(|within| *within),
        }
    }))
}

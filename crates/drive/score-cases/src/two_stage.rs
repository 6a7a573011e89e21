//! `two_stage/1`: sub-scores of first- and second-stage frames → weights, totals and aggregated columns.

use ds_score::constants::two_stage::SIGMA_SQUARED;
use ds_score::{StageColumns, StageMapping, StageRow, SubScores, two_stage};
use ds_space::DVec2;
use serde::Deserialize;
use serde_json::{Map, Value, json};

use crate::error::ScoreCaseError;

const COLUMN_NAMES: [&str; 10] = [
    "no_at_fault_collisions",
    "drivable_area_compliance",
    "driving_direction_compliance",
    "traffic_light_compliance",
    "ego_progress",
    "time_to_collision_within_bound",
    "lane_keeping",
    "history_comfort",
    "two_frame_extended_comfort",
    "score",
];

#[derive(Deserialize)]
pub(crate) struct Case {
    #[serde(default = "sigma_squared")]
    sigma_squared: f64,
    mapping: Vec<([String; 2], Vec<[String; 2]>)>,
    rows: Vec<Row>,
}

fn sigma_squared() -> f64 {
    SIGMA_SQUARED
}

#[derive(Deserialize)]
struct Row {
    token: String,
    no_at_fault_collisions: f64,
    drivable_area_compliance: f64,
    driving_direction_compliance: f64,
    traffic_light_compliance: f64,
    ego_progress: f64,
    time_to_collision_within_bound: f64,
    lane_keeping: f64,
    history_comfort: f64,
    two_frame_extended_comfort: f64,
    endpoint_x: f64,
    endpoint_y: f64,
    start_point_x: f64,
    start_point_y: f64,
}

pub(crate) fn answer(case: &Case) -> Result<Value, ScoreCaseError> {
    let rows: Vec<StageRow> = case.rows.iter().map(row).collect();
    let mapping: Vec<StageMapping> = case
        .mapping
        .iter()
        .map(|(first, second)| StageMapping { first: first.clone(), second: second.clone() })
        .collect();
    let result = two_stage(&rows, &mapping, case.sigma_squared).map_err(ScoreCaseError::score("rows"))?;
    Ok(json!({
        "expected": {
            "weight": result.weights,
            "score": result.scores,
            "combined": named(&result.combined),
            "stage_one": named(&result.stage_one),
            "stage_two": named(&result.stage_two),
        }
    }))
}

fn row(row: &Row) -> StageRow {
    StageRow {
        token: row.token.clone(),
        scores: SubScores {
            no_at_fault_collision: row.no_at_fault_collisions,
            drivable_area: row.drivable_area_compliance,
            driving_direction: row.driving_direction_compliance,
            traffic_light: row.traffic_light_compliance,
            ego_progress: row.ego_progress,
            time_to_collision: row.time_to_collision_within_bound,
            lane_keeping: row.lane_keeping,
            history_comfort: row.history_comfort,
        },
        extended_comfort: row.two_frame_extended_comfort,
        endpoint: DVec2::new(row.endpoint_x, row.endpoint_y),
        start: DVec2::new(row.start_point_x, row.start_point_y),
    }
}

fn named(columns: &StageColumns) -> Map<String, Value> {
    COLUMN_NAMES.iter().zip(columns).map(|(name, value)| ((*name).to_owned(), json!(value))).collect()
}

//! Aggregation of two-stage runs: second-stage frames weighted by how near they start to where the first plan ended.
//!
//! Groups "now" and "previous" have one first-stage frame and n second-stage frames each (`scoring.md` §6, PDM
//! `scene_aggregator.py:20-124`, `run_pdm_score.py:187-290`).

use std::collections::BTreeMap;

use ds_space::DVec2;

use crate::constants::two_stage::NO_WEIGHT;
use crate::epdms::SubScores;
use crate::error::{ScoreError, finite};

/// The columns that are aggregated: the eight sub-scores, EC, and the total.
const COLUMNS: usize = 10;

/// One frame of a two-stage run.
#[derive(Debug, Clone, PartialEq)]
pub struct StageRow {
    /// Its name.
    pub token: String,
    /// Its sub-scores.
    pub scores: SubScores,
    /// EC with the frame it is paired with.
    pub extended_comfort: f64,
    /// Where its plan ends (the plan's own last pose), in metres.
    pub endpoint: DVec2,
    /// Where it starts (rear axle), in metres.
    pub start: DVec2,
}

/// The frames that belong together, by token; pairs are (now, previous).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StageMapping {
    /// The first-stage pair.
    pub first: [String; 2],
    /// The second-stage pairs.
    pub second: Vec<[String; 2]>,
}

/// One value per column: NC, DAC, DDC, TLC, EP, TTC, LK, HC, EC, total.
pub type StageColumns = [f64; COLUMNS];

/// The aggregated scores.
#[derive(Debug, Clone, PartialEq)]
pub struct TwoStage {
    /// Weight by token: 1 for first-stage frames.
    pub weights: BTreeMap<String, f64>,
    /// EPDMS with EC by token, for all rows.
    pub scores: BTreeMap<String, f64>,
    /// First stage times weighted second stage, mean of groups and scenes.
    pub combined: StageColumns,
    /// The first stage alone.
    pub stage_one: StageColumns,
    /// The second stage alone.
    pub stage_two: StageColumns,
}

/// Aggregates the rows of a two-stage run; `sigma_squared` is the variance of the weights, in square metres.
///
/// # Errors
/// [`ScoreError`] names a missing token, an empty mapping or second stage, or a bad number.
pub fn two_stage(rows: &[StageRow], mapping: &[StageMapping], sigma_squared: f64) -> Result<TwoStage, ScoreError> {
    check(rows, sigma_squared)?;
    let by_token: BTreeMap<&str, &StageRow> = rows.iter().map(|row| (row.token.as_str(), row)).collect();
    let find =
        |token: &str| by_token.get(token).copied().ok_or_else(|| ScoreError::NoSuchRow { token: token.to_owned() });
    let needed = |what, found: usize| match found {
        0 => Err(ScoreError::TooFewStates { what, found, needed: 1 }),
        _ => Ok(()),
    };
    needed("mapping", mapping.len())?;
    let mut result = TwoStage {
        weights: BTreeMap::new(),
        scores: rows.iter().map(|row| (row.token.clone(), columns(row)[COLUMNS - 1])).collect(),
        combined: [0.0; COLUMNS],
        stage_one: [0.0; COLUMNS],
        stage_two: [0.0; COLUMNS],
    };
    let share = 1.0 / (2 * mapping.len()) as f64;
    for scene in mapping {
        needed("second stage", scene.second.len())?;
        for group in 0..2 {
            let first = find(&scene.first[group])?;
            let second = scene.second.iter().map(|pair| find(&pair[group])).collect::<Result<Vec<_>, _>>()?;
            let weights = weights(first, &second, sigma_squared);
            let one = columns(first);
            let mut two = [0.0; COLUMNS];
            for (row, weight) in second.iter().zip(&weights) {
                two.iter_mut().zip(columns(row)).for_each(|(sum, value)| *sum += weight * value);
                result.weights.insert(row.token.clone(), *weight);
            }
            result.weights.insert(first.token.clone(), 1.0);
            for column in 0..COLUMNS {
                result.stage_one[column] += share * one[column];
                result.stage_two[column] += share * two[column];
                result.combined[column] += share * one[column] * two[column];
            }
        }
    }
    Ok(result)
}

fn check(rows: &[StageRow], sigma_squared: f64) -> Result<(), ScoreError> {
    finite(1.0 / sigma_squared, || "1 / sigma_squared".to_owned())?;
    for (index, row) in rows.iter().enumerate() {
        for (name, point) in [("endpoint", row.endpoint), ("start", row.start)] {
            finite(point.x + point.y, || format!("rows[{index}].{name}"))?;
        }
        for (column, value) in columns(row).into_iter().enumerate() {
            finite(value, || format!("rows[{index}].column[{column}]"))?;
        }
    }
    Ok(())
}

fn columns(row: &StageRow) -> StageColumns {
    let scores = &row.scores;
    [
        scores.no_at_fault_collision,
        scores.drivable_area,
        scores.driving_direction,
        scores.traffic_light,
        scores.ego_progress,
        scores.time_to_collision,
        scores.lane_keeping,
        scores.history_comfort,
        row.extended_comfort,
        scores.epdms(Some(row.extended_comfort)),
    ]
}

/// Returns normalised Gaussian weights of the distance between a first plan's end and each start; uniform if all vanish.
fn weights(first: &StageRow, second: &[&StageRow], sigma_squared: f64) -> Vec<f64> {
    let weight = |row: &&StageRow| (-(first.endpoint - row.start).length_squared() / (2.0 * sigma_squared)).exp();
    let raw: Vec<f64> = second.iter().map(weight).collect();
    let sum: f64 = raw.iter().sum();
    let uniform = 1.0 / second.len() as f64;
    raw.iter().map(|weight| if sum > NO_WEIGHT { weight / sum } else { uniform }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(token: &str, ego_progress: f64, start_m: f64) -> StageRow {
        let scores = SubScores {
            no_at_fault_collision: 1.0,
            drivable_area: 1.0,
            driving_direction: 1.0,
            traffic_light: 1.0,
            ego_progress,
            time_to_collision: 1.0,
            lane_keeping: 1.0,
            history_comfort: 1.0,
        };
        let [endpoint, start] = [DVec2::ZERO, DVec2::new(start_m, 0.0)];
        StageRow { token: token.to_owned(), scores, extended_comfort: 1.0, endpoint, start }
    }

    fn mapping(second: &[[&str; 2]]) -> Vec<StageMapping> {
        let own = |pair: &[&str; 2]| pair.map(str::to_owned);
        vec![StageMapping { first: own(&["n", "p"]), second: second.iter().map(own).collect() }]
    }

    #[test]
    fn by_hand() {
        // d² = 0 and 0.2·ln 3: weights 3/4 and 1/4. EP column: 0.8·(¾·1 + ¼·0.2) = 0.64 and 0.5·1.
        let far_m = (0.2 * 3.0f64.ln()).sqrt();
        let rows =
            [row("n", 0.8, 0.0), row("p", 0.5, 0.0), row("a", 1.0, 0.0), row("b", 0.2, far_m), row("c", 1.0, 0.0)];
        let got = two_stage(&rows, &mapping(&[["a", "c"], ["b", "c"]]), 0.1).expect("sound rows");
        assert!((got.weights["a"] - 0.75).abs() < 1e-12 && (got.weights["b"] - 0.25).abs() < 1e-12);
        assert!((got.combined[4] - (0.64 + 0.5) / 2.0).abs() < 1e-12);
        assert!((got.stage_one[4] - 0.65).abs() < 1e-12 && (got.stage_two[4] - 0.9).abs() < 1e-12);
        assert!((got.scores["b"] - (16.0 - 4.0) / 16.0).abs() < 1e-12);
    }

    #[test]
    fn far_frames_count_alike_and_missing_ones_are_named() {
        let rows = [row("n", 1.0, 0.0), row("p", 1.0, 0.0), row("a", 1.0, 50.0), row("b", 0.0, 60.0)];
        let got = two_stage(&rows, &mapping(&[["a", "a"], ["b", "b"]]), 0.1).expect("sound rows");
        assert_eq!((got.weights["a"], got.weights["b"]), (0.5, 0.5));
        for (bad, says) in [(mapping(&[["a", "z"]]), "no row has token \"z\""), (mapping(&[]), "second stage has 0")] {
            let error = two_stage(&rows, &bad, 0.1).expect_err(says).to_string();
            assert!(error.contains(says), "{error}");
        }
    }
}

//! The answer of a `pdm_score/1` case: v2 and v1 scores of each candidate, states, areas, first violations, stability.
//!
//! A candidate is stable if noise of 1e-6 m on its executed positions changes no discrete sub-score in three draws.

use ds_score::{Executed, NavsimV1, NavsimV2, PreparedScene, SubScores, VehicleState, Yardstick, navsim_v1_executed};
use ds_space::Draws;
use serde_json::{Value, json};

use crate::error::ScoreCaseError;
use crate::pdm_score::{Candidate, Case};

const NOISE_M: f64 = 1e-6;
const NOISE_DRAWS: u64 = 3;
const NOISE_SEED: u64 = 1;

pub(crate) fn answer(case: &Case) -> Result<Value, ScoreCaseError> {
    let scene = PreparedScene::new(&case.scene()?).map_err(ScoreCaseError::score("map, ego, past and agents"))?;
    let human = case.human.as_ref().map(|human| human.plan());
    let yardstick = Yardstick::new(&scene, &case.reference.plan(), human.as_ref())
        .map_err(ScoreCaseError::score("reference and human"))?;
    let mut candidates = Vec::with_capacity(case.candidates.len());
    for (index, candidate) in case.candidates.iter().enumerate() {
        let answered = answer_candidate(&scene, &yardstick, candidate);
        candidates.push(answered.map_err(ScoreCaseError::score(format!("candidates[{index}]")))?);
    }
    Ok(json!({ "candidates": candidates, "reference_simulated_states": columns(yardstick.states()) }))
}

fn answer_candidate(
    scene: &PreparedScene,
    yardstick: &Yardstick,
    candidate: &Candidate,
) -> Result<Value, ds_score::ScoreError> {
    let plan = candidate.trajectory.plan();
    let v2 = yardstick.score(scene, &plan)?;
    let v1 = navsim_v1_executed(scene, yardstick.states(), &v2.states)?;
    let mut stable = true;
    for draw in 0..NOISE_DRAWS {
        let noisy = noisy(&v2.states, draw);
        let again = yardstick.score_executed(scene, &noisy, v2.coverage)?;
        let again_v1 = navsim_v1_executed(scene, yardstick.states(), &noisy)?;
        stable &= discrete(&v2, &v1) == discrete(&again, &again_v1);
    }
    let step = |violation: Option<ds_score::Violation>| violation.map(|violation| violation.step);
    let mut expected_v2 = named(&v2.scores);
    let more = json!({
        "multiplier_product": v2.scores.multipliers(),
        "epdms_without_ec": v2.epdms,
        "unfiltered": named(&v2.unfiltered),
        "pdm_score_unfiltered": v2.epdms_unfiltered,
        "reference": named(&v2.reference),
        "progress_raw_m": [v2.reference_progress_raw_m, v2.progress_raw_m],
        "first_at_fault_step": step(v2.first.at_fault),
        "first_ttc_step": step(v2.first.time_to_collision),
        "ego_area": {
            "multiple_lanes": v2.areas.multiple_lanes.text(),
            "non_drivable": v2.areas.non_drivable.text(),
            "oncoming": v2.areas.oncoming.text(),
        },
        "comfort_terms_no_history": v2.comfort_terms,
        "stable": stable,
        "simulated_states": columns(&v2.states),
    });
    if let (Value::Object(all), Value::Object(more)) = (&mut expected_v2, more) {
        all.extend(more);
    }
    Ok(json!({
        "name": candidate.name,
        "expected_v2": expected_v2,
        "expected_v1": {
            "nc": v1.no_at_fault_collision,
            "dac": v1.drivable_area,
            "ddc_weight0": v1.driving_direction,
            "ep": v1.ego_progress,
            "ttc": v1.time_to_collision,
            "c": v1.comfort,
            "pdms": v1.pdms,
        },
    }))
}

fn named(scores: &SubScores) -> Value {
    json!({
        "nc": scores.no_at_fault_collision,
        "dac": scores.drivable_area,
        "ddc": scores.driving_direction,
        "tlc": scores.traffic_light,
        "ep": scores.ego_progress,
        "ttc": scores.time_to_collision,
        "lk": scores.lane_keeping,
        "hc": scores.history_comfort,
    })
}

fn columns(states: &Executed) -> Vec<[f64; 11]> {
    states.iter().map(VehicleState::columns).collect()
}

/// All discrete sub-scores; the areas and first violating steps are not asked, as in the reference cases.
fn discrete(v2: &NavsimV2, v1: &NavsimV1) -> impl PartialEq + use<> {
    let without_progress = |scores: SubScores| SubScores { ego_progress: 1.0, ..scores };
    (
        without_progress(v2.scores),
        without_progress(v2.unfiltered),
        (v1.no_at_fault_collision, v1.drivable_area, v1.driving_direction, v1.time_to_collision, v1.comfort),
    )
}

fn noisy(states: &Executed, draw: u64) -> Executed {
    let draws = Draws::from_seed(NOISE_SEED, "stability");
    let mut states = *states;
    for (step, state) in (0u64..).zip(&mut states) {
        let index = 2 * (draw * ds_score::constants::horizon::STATES as u64 + step);
        state.x_m += NOISE_M * draws.normal(index);
        state.y_m += NOISE_M * draws.normal(index + 1);
    }
    states
}

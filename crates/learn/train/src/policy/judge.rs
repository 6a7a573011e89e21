//! The sub-scores of plans from a sample's state: what scorers of the panel learn to predict.
//!
//! The `navsim_v2` terms against logged agents, without the human filter and EC, EP normalised over the plans and the
//! reference plan; ½ counts as 0, as published scorers are trained.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use ds_graph::panel::TERMS;
use ds_nn::team::Team;
use ds_policy::camera::proposals::{KNOT_SECS, KNOTS};
use ds_score::{
    PlannedPoses, PreparedMap, PreparedScene, ScoreError, SubScores, log_tracks, open_loop_map, rank_plans,
    reference_plan, scene_now,
};
use ds_space::{DVec2, PoseSe2};
use ds_world::{EgoState, Scene};

use super::PolicyTrainError;
use super::dataset::{Sample, ScenarioSplit, scene};

/// States of a rollout: now and 40 steps of 0.1 s.
const STATES: usize = 41;

/// Scores plans on all cores; scenes that were met before are kept.
pub(super) struct Judge {
    team: Team,
    scenes: BTreeMap<u64, (Scene, Arc<PreparedMap>)>,
}

impl Default for Judge {
    fn default() -> Self {
        Self { team: Team::of_all_cores(), scenes: BTreeMap::new() }
    }
}

impl Judge {
    /// Returns for each training sample the terms of each of its plans, from its state: NC, DAC, DDC, TLC, EP, TTC, LK, HC.
    pub(super) fn terms(
        &mut self,
        asked: &[(&Sample, Vec<[PoseSe2; KNOTS]>)],
    ) -> Result<Vec<Vec<[f32; TERMS]>>, PolicyTrainError> {
        let scenarios: BTreeSet<u64> = asked.iter().map(|(sample, _)| sample.place.scenario).collect();
        let unknown: Vec<u64> = scenarios.into_iter().filter(|index| !self.scenes.contains_key(index)).collect();
        for (index, met) in unknown.iter().zip(self.team.run(unknown.len(), |at| met(unknown[at]))) {
            self.scenes.insert(*index, met?);
        }
        let scores = self.team.run(asked.len(), |at| {
            let (sample, plans) = &asked[at];
            let (scene, map) = &self.scenes[&sample.place.scenario];
            ranked(scene, map, sample, plans).map_err(|source| refused(scene, source))
        });
        scores.into_iter().collect()
    }
}

/// Prepares a scene for scoring.
fn met(index: u64) -> Result<(Scene, Arc<PreparedMap>), PolicyTrainError> {
    let scene = scene(ScenarioSplit::Training, index);
    let map = PreparedMap::new(&open_loop_map(&scene)).map_err(|source| refused(&scene, source))?;
    Ok((scene, Arc::new(map)))
}

fn refused(scene: &Scene, source: ScoreError) -> PolicyTrainError {
    PolicyTrainError::Score { name: scene.name.clone(), source }
}

fn ranked(
    scene: &Scene,
    map: &Arc<PreparedMap>,
    sample: &Sample,
    plans: &[[PoseSe2; KNOTS]],
) -> Result<Vec<[f32; TERMS]>, ScoreError> {
    let [along, across] = sample.acceleration_mps2.map(f64::from);
    let ego = EgoState {
        pose: sample.place.pose,
        velocity_mps: DVec2::new(f64::from(sample.speed_mps), 0.0),
        yaw_rate_radps: f64::from(sample.yaw_rate_radps),
        acceleration_mps2: DVec2::new(along, across),
        ..scene.ego_log[0]
    };
    let agents = log_tracks(scene, sample.place.tick, STATES);
    let now = scene_now(scene, sample.place.tick, &[ego], agents).expect("there is a state of the ego");
    let prepared = PreparedScene::on(map, &now)?;
    let reference = reference_plan(&prepared, None)?.plan;
    let plan = |poses: &[PoseSe2; KNOTS]| PlannedPoses { dt_s: KNOT_SECS, poses: poses.to_vec() };
    let plans: Vec<PlannedPoses> = plans.iter().map(plan).collect();
    let ranking = rank_plans(&prepared, &reference, &plans)?;
    Ok(ranking.scores.iter().map(|score| terms_of(&score.scores)).collect())
}

#[expect(clippy::cast_possible_truncation, reason = "labels are single precision")]
fn terms_of(scores: &SubScores) -> [f32; TERMS] {
    let whole = |value: f64| if value < 0.75 { 0.0 } else { 1.0 };
    [
        whole(scores.no_at_fault_collision),
        whole(scores.drivable_area),
        whole(scores.driving_direction),
        whole(scores.traffic_light),
        scores.ego_progress as f32,
        whole(scores.time_to_collision),
        whole(scores.lane_keeping),
        whole(scores.history_comfort),
    ]
}

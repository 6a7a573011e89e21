//! The oracle: many proposals of one moment, scored with the v2 sub-metrics and compared with each other.
//!
//! EP is normalised over all proposals and the reference; no human filter; EC left out (divisor 14). Proposals are plans,
//! executed by the score's own tracker among agents that do not react, or rollouts, which bring executed states and the
//! agents that reacted to them.

use crate::constants::NAVSIM_V2_VERSION;
use crate::epdms::{FirstViolations, Measured, SubScores, check_states, measure};
use crate::error::ScoreError;
use crate::metric::ego_progress;
use crate::motion::{Executed, PlannedPoses, VehicleState};
use crate::proposal::Memory;
use crate::scene::{PreparedScene, Traffic};

/// A proposal that was driven already.
#[derive(Debug, Clone, Copy)]
pub struct Rollout<'a> {
    /// Its executed states.
    pub states: &'a Executed,
    /// Agents of its own, besides those of the scene; see [`PreparedScene::traffic_of`].
    pub reacting: Option<&'a Traffic>,
}

/// The score of a proposal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OracleScore {
    /// The sub-scores.
    pub scores: SubScores,
    /// The total, without EC.
    pub epdms: f64,
    /// Progress along the centreline, in metres.
    pub progress_raw_m: f64,
    /// The first violations.
    pub first: FirstViolations,
}

/// The scores of all proposals of a moment.
#[derive(Debug, Clone, PartialEq)]
pub struct OracleRanking {
    /// The definition of the sub-metrics.
    pub version: &'static str,
    /// One score per proposal, in their order.
    pub scores: Vec<OracleScore>,
    /// The reference plan's score.
    pub reference: OracleScore,
}

impl OracleRanking {
    /// Returns the index of the best proposal, the first of equals; `None` without proposals.
    #[must_use]
    pub fn best(&self) -> Option<usize> {
        let better = |best: Option<usize>, index: usize| match best {
            Some(best) if self.scores[best].epdms >= self.scores[index].epdms => Some(best),
            _ => Some(index),
        };
        (0..self.scores.len()).fold(None, better)
    }
}

/// Ranks plans in a prepared scene.
///
/// # Errors
/// [`ScoreError`] if a plan is refused.
pub fn rank_plans(
    scene: &PreparedScene,
    reference: &PlannedPoses,
    plans: &[PlannedPoses],
) -> Result<OracleRanking, ScoreError> {
    let mut memory = Memory::default();
    let mut states = [VehicleState::default(); crate::constants::horizon::STATES];
    let mut own = |plan: &PlannedPoses| {
        scene.executor.execute_into(&scene.ego, plan, &mut states)?;
        Ok(measure(scene, &[&scene.traffic], scene.past.as_deref(), &states, &mut memory))
    };
    let reference = own(reference)?;
    let proposals = plans.iter().map(own).collect::<Result<Vec<_>, ScoreError>>()?;
    Ok(ranking(reference, proposals))
}

/// Ranks rollouts in a prepared scene; the scene's own agents should be those that do not react.
///
/// # Errors
/// [`ScoreError::NotFinite`] names a bad state.
pub fn rank_rollouts(
    scene: &PreparedScene,
    reference: &Rollout<'_>,
    rollouts: &[Rollout<'_>],
) -> Result<OracleRanking, ScoreError> {
    let mut memory = Memory::default();
    let mut own = |rollout: &Rollout<'_>| {
        check_states(rollout.states)?;
        let all = [Some(&scene.traffic), rollout.reacting];
        let present = if rollout.reacting.is_some() { 2 } else { 1 };
        let traffic = all.map(|traffic| traffic.unwrap_or(&scene.traffic));
        Ok(measure(scene, &traffic[..present], scene.past.as_deref(), rollout.states, &mut memory))
    };
    let reference = own(reference)?;
    let proposals = rollouts.iter().map(own).collect::<Result<Vec<_>, ScoreError>>()?;
    Ok(ranking(reference, proposals))
}

fn ranking(reference: Measured, proposals: Vec<Measured>) -> OracleRanking {
    let all = std::iter::once(&reference).chain(&proposals);
    let best_m = ego_progress::best_m(all.map(Measured::progress));
    let score = |measured: Measured| {
        let measured = measured.with_progress(best_m);
        OracleScore {
            scores: measured.scores,
            epdms: measured.scores.epdms(None),
            progress_raw_m: measured.progress_raw_m,
            first: measured.first,
        }
    };
    OracleRanking {
        version: NAVSIM_V2_VERSION,
        scores: proposals.into_iter().map(score).collect(),
        reference: score(reference),
    }
}

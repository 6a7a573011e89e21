//! The oracle scorer: each proposal of a plan is driven for 4 s in a copy of the world of now, and scored there.
//!
//! The copy has its own ego dynamics and tracker; agents within 50 m react, the rest follow the log, map and paths are
//! shared. Scores are the NAVSIM v2 sub-metrics at the scenario's ego size, human filter off, without EC (divisor 14),
//! EP normalised over the proposals and the reference plan (issue of scale: `docs/scoring.md`). In the open form the
//! score's own tracker executes the plans among agents that do not react to them. No clock, no draws: same world, same
//! ranking, however many threads.

mod moment;
mod place;

use std::sync::Arc;

use ds_score::{
    Executed, OracleRanking, PlannedPoses, PreparedScene, Rollout, ScoreError, Traffic, rank_plans, rank_rollouts,
    reference_plan,
};
use ds_sim::Simulation;
use ds_space::SimTime;
use ds_world::{Proposal, Scene, Trajectory, TrajectoryPoint};
use rayon::prelude::*;

use moment::Driven;
use place::Place;

/// How agents behave in a rollout.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AgentsIn {
    /// Each rollout has its own agents, which react to its ego.
    Reacting,
    /// Agents do as they do beside the policy's favourite; plans are executed by the score's own tracker.
    Open,
}

/// Why proposals were not ranked.
#[derive(Debug, thiserror::Error)]
pub enum OracleError {
    /// The scene cannot be scored.
    #[error("scene cannot be scored")]
    Scene(#[source] ScoreError),
    /// A moment cannot be scored.
    #[error("proposals at tick {tick} cannot be scored")]
    Moment {
        /// The tick of the world of now.
        tick: u32,
        /// Why.
        #[source]
        source: ScoreError,
    },
    /// There is nothing to rank.
    #[error("there is no proposal")]
    Empty,
}

/// How the proposals of a moment came out.
#[derive(Debug, Clone, PartialEq)]
pub struct Ranked {
    /// Index of the best: the highest score, among equals the policy's own favourite, then the first.
    pub chosen: usize,
    /// Score of each proposal, 0 to 1.
    pub scores: Vec<f64>,
    /// Score of the reference plan, 0 to 1.
    pub reference: f64,
    /// The sub-scores behind them.
    pub ranking: OracleRanking,
}

/// Ranks proposals in one scene.
#[derive(Debug, Clone)]
pub struct Oracle {
    place: Arc<Place>,
}

impl Oracle {
    /// Prepares for a scene; the map is indexed once.
    ///
    /// # Errors
    /// [`OracleError::Scene`] if there is nothing to score in it.
    pub fn new(scene: &Scene) -> Result<Self, OracleError> {
        Ok(Self { place: Arc::new(Place::new(scene).map_err(OracleError::Scene)?) })
    }

    /// Ranks the proposals at the simulation's tick; poses are in the rig frame there.
    ///
    /// # Errors
    /// [`OracleError`] if there is no proposal or the moment cannot be scored.
    pub fn rank(&self, now: &Simulation, proposals: &[Proposal], agents: AgentsIn) -> Result<Ranked, OracleError> {
        if proposals.is_empty() {
            return Err(OracleError::Empty);
        }
        let tick = now.state().tick.0;
        let failed = |source| OracleError::Moment { tick, source };
        let beside = Driven::of(now, &proposals[favourite(proposals)].trajectory);
        let scene = self.place.moment(now, &beside, true).map_err(failed)?;
        let reference = reference_plan(&scene, None).map_err(failed)?.plan;
        let ranking = match agents {
            AgentsIn::Open => {
                let plans: Vec<PlannedPoses> =
                    proposals.iter().map(|proposal| PlannedPoses::of(&proposal.trajectory)).collect();
                rank_plans(&scene, &reference, &plans).map_err(failed)?
            }
            AgentsIn::Reacting => {
                let scene = self.place.moment(now, &beside, false).map_err(failed)?;
                ranked_rollouts(now, &scene, &trajectory(&reference), proposals).map_err(failed)?
            }
        };
        let scores: Vec<f64> = ranking.scores.iter().map(|score| score.epdms).collect();
        let chosen = best(&scores, proposals);
        Ok(Ranked { chosen, scores, reference: ranking.reference.epdms, ranking })
    }
}

fn ranked_rollouts(
    now: &Simulation,
    scene: &PreparedScene,
    reference: &Trajectory,
    proposals: &[Proposal],
) -> Result<OracleRanking, ScoreError> {
    let drive = |trajectory: &Trajectory| {
        let driven = Driven::of(now, trajectory);
        let traffic = scene.traffic_of(&driven.tracks)?;
        Ok((driven.states, traffic))
    };
    let drives: Vec<(Box<Executed>, Traffic)> =
        proposals.par_iter().map(|proposal| drive(&proposal.trajectory)).collect::<Result<_, ScoreError>>()?;
    let rollouts: Vec<Rollout<'_>> =
        drives.iter().map(|(states, traffic)| Rollout { states, reacting: Some(traffic) }).collect();
    let (states, traffic) = drive(reference)?;
    rank_rollouts(scene, &Rollout { states: &states, reacting: Some(&traffic) }, &rollouts)
}

/// Returns a plan as a trajectory.
fn trajectory(plan: &PlannedPoses) -> Trajectory {
    let point = |(index, pose): (u32, &ds_space::PoseSe2)| TrajectoryPoint {
        after: SimTime::from_secs(f64::from(index) * plan.dt_s),
        pose: *pose,
    };
    Trajectory::new((1..).zip(&plan.poses).map(point).collect()).expect("the planner's poses are finite and in order")
}

/// Returns the index of the proposal that the policy itself likes best, the first of equals.
fn favourite(proposals: &[Proposal]) -> usize {
    (0..proposals.len())
        .fold(0, |best, index| if proposals[index].score > proposals[best].score { index } else { best })
}

/// Returns the index of the highest score; among equals that of the policy's own favourite, then the first.
fn best(scores: &[f64], proposals: &[Proposal]) -> usize {
    let mut best = 0;
    for index in 1..scores.len() {
        let (a, b) = (scores[index], scores[best]);
        if a > b || (a.total_cmp(&b).is_eq() && proposals[index].score > proposals[best].score) {
            best = index;
        }
    }
    best
}

#[cfg(test)]
mod tests;

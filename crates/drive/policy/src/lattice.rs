//! A lattice of 64 arcs: eight curvatures by eight accelerations, ranked by what a blind driver would prefer.
//!
//! Unprivileged and without frames: the score likes the present curvature bent a little by the route command, a steady
//! speed and gentle sideways acceleration. It exists so that proposals can be ranked by an oracle before a stronger
//! policy is connected: what the lattice covers, the oracle can find.

use ds_space::PoseSe2;
use ds_world::{Proposal, RouteCommand};

use crate::error::PolicyError;
use crate::observation::{Observation, PrivilegedView};
use crate::plan::{PolicyAnswer, evenly_spaced};
use crate::{Policy, Restart};

/// The policy's name.
pub const NAME: &str = "lattice";
/// Yaw rates at the end of the entry, as sideways accelerations: m/s² at the present speed.
const SIDEWAYS_MPS2: [f64; 8] = [-3.0, -1.5, -0.6, -0.15, 0.15, 0.6, 1.5, 3.0];
/// The strongest curvature that a car can drive, 1/m.
const MOST_CURVATURE_PER_M: f64 = 0.18;
/// Accelerations, in metres per second squared.
const ACCELERATIONS_MPS2: [f64; 8] = [-4.0, -2.5, -1.5, -0.8, -0.3, 0.0, 0.6, 1.2];
/// The lattice's curvature is reached after this time, from the present one.
const ENTRY_SECS: f64 = 1.0;
/// Below this speed curvature is bounded alone, in metres per second.
const CREEP_MPS: f64 = 1.0;
/// Which sideways acceleration a turn asks for.
const TURN_MPS2: f64 = 0.6;
/// No plan is faster, in metres per second.
const MOST_SPEED_MPS: f64 = 25.0;

/// Proposes 64 arcs and likes the steadiest best.
#[derive(Debug, Clone, Copy, Default)]
pub struct Lattice;

/// One node of the lattice.
struct Arc {
    curvature_per_m: f64,
    acceleration_mps2: f64,
}

impl Policy for Lattice {
    fn name(&self) -> &str {
        NAME
    }

    fn privileged(&self) -> bool {
        false
    }

    fn plan(&mut self, observation: &Observation, _: Option<&PrivilegedView>) -> Result<PolicyAnswer, PolicyError> {
        observation.check()?;
        let mut proposals = Vec::with_capacity(SIDEWAYS_MPS2.len() * ACCELERATIONS_MPS2.len());
        let speed_mps = observation.ego.speed_mps.max(CREEP_MPS);
        for sideways_mps2 in SIDEWAYS_MPS2 {
            let curvature = sideways_mps2 / (speed_mps * speed_mps);
            let curvature_per_m = curvature.clamp(-MOST_CURVATURE_PER_M, MOST_CURVATURE_PER_M);
            for acceleration_mps2 in ACCELERATIONS_MPS2 {
                let arc = Arc { curvature_per_m, acceleration_mps2 };
                let poses = poses(&arc, observation);
                let trajectory = evenly_spaced(NAME, &poses, observation.dt)?;
                proposals.push(Proposal { trajectory, score: liking(&arc, observation) });
            }
        }
        let mut best = 0;
        for index in 1..proposals.len() {
            if proposals[index].score > proposals[best].score {
                best = index;
            }
        }
        Ok(PolicyAnswer { trajectory: proposals[best].trajectory.clone(), proposals, context: None })
    }

    fn restart(&self) -> Restart {
        Restart::Stateless
    }
}

fn present_curvature(observation: &Observation) -> f64 {
    let ego = &observation.ego;
    let curvature = if ego.speed_mps > CREEP_MPS { ego.yaw_rate_radps / ego.speed_mps } else { 0.0 };
    curvature.clamp(-MOST_CURVATURE_PER_M, MOST_CURVATURE_PER_M)
}

/// Returns the poses of an arc, one a tick, by steps of constant curvature.
fn poses(arc: &Arc, observation: &Observation) -> Vec<PoseSe2> {
    let dt = observation.dt.secs();
    let (from, mut pose) = (present_curvature(observation), PoseSe2::new(0.0, 0.0, 0.0));
    let mut speed_mps = observation.ego.speed_mps.max(0.0);
    let mut poses = Vec::with_capacity(observation.horizon_ticks as usize);
    for tick in 1..=observation.horizon_ticks {
        let next_mps = (speed_mps + arc.acceleration_mps2 * dt).clamp(0.0, MOST_SPEED_MPS.max(speed_mps));
        let way_m = 0.5 * (speed_mps + next_mps) * dt;
        let share = (f64::from(tick) * dt / ENTRY_SECS).min(1.0);
        let turn_rad = (from + (arc.curvature_per_m - from) * share) * way_m;
        let middle_rad = pose.heading_rad + 0.5 * turn_rad;
        let (x, y) = (pose.position.x + way_m * middle_rad.cos(), pose.position.y + way_m * middle_rad.sin());
        pose = PoseSe2::new(x, y, pose.heading_rad + turn_rad);
        speed_mps = next_mps;
        poses.push(pose);
    }
    poses
}

/// Returns how much a blind driver likes an arc; 0 is best.
fn liking(arc: &Arc, observation: &Observation) -> f64 {
    let speed_mps = observation.ego.speed_mps.max(CREEP_MPS);
    let wanted = match observation.command {
        RouteCommand::Left => TURN_MPS2,
        RouteCommand::Right => -TURN_MPS2,
        RouteCommand::Straight => 0.0,
    };
    let kept = present_curvature(observation) * speed_mps * speed_mps;
    let sideways = arc.curvature_per_m * speed_mps * speed_mps;
    -((sideways - 0.5 * (wanted + kept)).powi(2) + 2.0 * arc.acceleration_mps2.powi(2) + 0.1 * sideways.powi(2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observation::EgoView;
    use ds_space::{Draws, SimTime};

    fn answer(speed_mps: f64, yaw_rate_radps: f64, command: RouteCommand) -> PolicyAnswer {
        let observation = Observation {
            frames: vec![],
            cameras: vec![],
            ego: EgoView { speed_mps, yaw_rate_radps, ..EgoView::default() },
            command,
            stamps: vec![SimTime(0)],
            horizon_ticks: 80,
            dt: SimTime::from_secs(0.1),
            draw: Draws::from_seed(0, "test"),
        };
        Lattice.plan(&observation, None).expect("plans")
    }

    #[test]
    fn there_are_64_different_proposals_and_the_answer_is_one_of_them() {
        for speed_mps in [0.0, 3.0, 12.0, 30.0] {
            let answer = answer(speed_mps, 0.0, RouteCommand::Straight);
            assert_eq!(answer.proposals.len(), 64);
            let best = answer.proposals.iter().max_by(|a, b| a.score.total_cmp(&b.score)).expect("proposals");
            assert_eq!(best.trajectory.points().len(), answer.trajectory.points().len());
            assert!(answer.proposals.iter().any(|proposal| proposal.trajectory == answer.trajectory));
        }
        let moving = answer(10.0, 0.0, RouteCommand::Straight).proposals;
        for (index, one) in moving.iter().enumerate() {
            assert!(moving[index + 1..].iter().all(|other| other.trajectory != one.trajectory));
        }
    }

    #[test]
    fn the_favourite_goes_on_and_bends_as_told() {
        let end = |answer: PolicyAnswer| answer.trajectory.at(SimTime::from_secs(4.0)).position;
        let straight = end(answer(10.0, 0.0, RouteCommand::Straight));
        assert!((straight.x - 40.0).abs() < 0.5 && straight.y.abs() < 2.0, "{straight}");
        let left = end(answer(10.0, 0.0, RouteCommand::Left));
        assert!(left.y > straight.y + 1.0, "{left}");
        let curve = end(answer(10.0, 0.12, RouteCommand::Straight));
        assert!(curve.y > 2.0, "{curve}");
    }
}

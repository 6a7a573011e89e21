//! What the network's numbers mean: its state inputs, and its outputs as scored trajectories of eight poses at 0.5 s.
//!
//! Each mode has 8 × (x, y, heading) and a logit. Poses are offsets from going straight on at the present speed, in units
//! that grow with time, so that all outputs are of order one. Rig frame of now, metres, radians.

use ds_graph::panel::{POSE_SECS, SPEED_MPS, straight_on_m, units};
use ds_space::{DVec2, PoseSe2, SimTime, angle};
use ds_world::{Proposal, RouteCommand};

use crate::error::PolicyError;
use crate::observation::Observation;
use crate::plan::{PolicyAnswer, evenly_spaced};

/// Candidates per answer.
pub const MODES: usize = 4;
/// Poses per candidate.
pub const KNOTS: usize = 8;
/// Time between poses, in seconds.
pub const KNOT_SECS: f64 = POSE_SECS;
/// Numbers of one candidate: three per pose.
pub const TARGETS: usize = KNOTS * 3;
/// Numbers of output: each candidate, then one logit each.
pub const OUTPUTS: usize = MODES * (TARGETS + 1);
/// Numbers of state: the speed twice (plain, and whether the car stands) and the command.
pub const STATE: usize = 5;

/// A car whose plan covers less than this in 4 s stands still, in metres.
const STANDING_M: f64 = 0.5;
/// The largest yaw rate at which a plan goes on beyond its last pose, in radians per second.
const MOST_YAW_RATE_RADPS: f64 = 0.6;

/// One candidate.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Poses at 0.5 s, 1.0 s, … 4.0 s.
    pub knots: [PoseSe2; KNOTS],
    /// The network's probability that this one is right, the score that it expects of it, or its logit: more is better.
    pub score: f64,
}

/// Returns the state inputs.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "inputs are single precision")]
pub fn state_of(speed_mps: f64, command: RouteCommand) -> [f32; STATE] {
    let is = |wanted| f32::from(u8::from(command == wanted));
    [
        (speed_mps / SPEED_MPS) as f32,
        (-speed_mps.max(0.0)).exp() as f32,
        is(RouteCommand::Straight),
        is(RouteCommand::Left),
        is(RouteCommand::Right),
    ]
}

/// Returns the numbers that stand for eight poses, in the layout of one candidate.
#[must_use]
#[expect(clippy::cast_possible_truncation, reason = "targets are single precision")]
pub fn encode(speed_mps: f64, knots: &[PoseSe2; KNOTS]) -> [f32; TARGETS] {
    let mut targets = [0.0; TARGETS];
    for (knot, pose) in knots.iter().enumerate() {
        let [x, y, heading] = units(knot);
        targets[3 * knot] = ((pose.position.x - straight_on_m(speed_mps, knot)) / x) as f32;
        targets[3 * knot + 1] = (pose.position.y / y) as f32;
        targets[3 * knot + 2] = (pose.heading_rad / heading) as f32;
    }
    targets
}

/// Returns the candidates that the outputs of one sample stand for.
///
/// # Panics
/// If there are not [`OUTPUTS`] numbers.
#[must_use]
pub fn decode(speed_mps: f64, outputs: &[f32]) -> Vec<Candidate> {
    assert_eq!(outputs.len(), OUTPUTS, "the network gives this many numbers");
    let (targets, logits) = outputs.split_at(MODES * TARGETS);
    let highest = logits.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let weights: Vec<f64> = logits.iter().map(|logit| f64::from(logit - highest).exp()).collect();
    let sum: f64 = weights.iter().sum();
    let candidates = targets.chunks_exact(TARGETS).zip(weights);
    let candidate = |(targets, weight)| Candidate { knots: knots_of(speed_mps, targets), score: weight / sum };
    candidates.map(candidate).collect()
}

/// Returns the poses that the numbers of one candidate stand for; the inverse of [`encode`].
///
/// # Panics
/// If there are fewer than [`TARGETS`] numbers.
#[must_use]
pub fn knots_of(speed_mps: f64, targets: &[f32]) -> [PoseSe2; KNOTS] {
    std::array::from_fn(|knot| {
        let [x, y, heading] = units(knot);
        let at = |field: usize| f64::from(targets[3 * knot + field]);
        let forward = straight_on_m(speed_mps, knot) + at(0) * x;
        PoseSe2 { position: DVec2::new(forward, at(1) * y), heading_rad: angle::wrap(at(2) * heading) }
    })
}

/// Makes the answer of a network: every candidate continued to the asked horizon, the most probable one first of equals.
pub(crate) fn answer(
    name: &'static str,
    observation: &Observation,
    candidates: &[Candidate],
) -> Result<PolicyAnswer, PolicyError> {
    let mut proposals = Vec::with_capacity(candidates.len());
    for candidate in candidates {
        let (horizon_ticks, dt) = (observation.horizon_ticks, observation.dt);
        let poses = poses_at_ticks(observation.ego.speed_mps, &candidate.knots, horizon_ticks, dt);
        proposals.push(Proposal { trajectory: evenly_spaced(name, &poses, dt)?, score: candidate.score });
    }
    let best = proposals.iter().reduce(|best, next| if next.score > best.score { next } else { best });
    let trajectory = best.expect("the network always makes proposals").trajectory.clone();
    Ok(PolicyAnswer { trajectory, proposals, context: None })
}

/// Returns the poses after each of `ticks` ticks: a smooth curve through the knots, then constant speed and curvature.
#[must_use]
pub fn poses_at_ticks(speed_mps: f64, knots: &[PoseSe2; KNOTS], ticks: u32, dt: SimTime) -> Vec<PoseSe2> {
    if knots[KNOTS - 1].position.length() < STANDING_M {
        return vec![PoseSe2::default(); ticks as usize];
    }
    (1..=ticks).map(|tick| pose_at(speed_mps, knots, dt.secs() * f64::from(tick))).collect()
}

fn pose_at(speed_mps: f64, knots: &[PoseSe2; KNOTS], after_secs: f64) -> PoseSe2 {
    let end_secs = KNOT_SECS * KNOTS as f64;
    if after_secs > end_secs {
        return continued(&knots[KNOTS - 2], &knots[KNOTS - 1], KNOT_SECS, after_secs - end_secs);
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and the number of knots")]
    let segment = ((after_secs / KNOT_SECS - 1e-9) as usize).min(KNOTS - 1);
    let share = after_secs / KNOT_SECS - segment as f64;
    let knot = |index: usize| if index == 0 { PoseSe2::default() } else { knots[index - 1] };
    let tangent = |index: usize| match index {
        0 => DVec2::new(speed_mps.max(0.0) * KNOT_SECS, 0.0),
        KNOTS => knot(index).position - knot(index - 1).position,
        _ => 0.5 * (knot(index + 1).position - knot(index - 1).position),
    };
    let (from, to) = (knot(segment), knot(segment + 1));
    let (s2, s3) = (share * share, share * share * share);
    let position = from.position * (2.0 * s3 - 3.0 * s2 + 1.0)
        + tangent(segment) * (s3 - 2.0 * s2 + share)
        + to.position * (3.0 * s2 - 2.0 * s3)
        + tangent(segment + 1) * (s3 - s2);
    PoseSe2 { position, ..from.lerp(&to, share) }
}

/// Returns the pose some time after the last of two, which lie `spacing_secs` apart, at their speed and curvature.
pub(crate) fn continued(before: &PoseSe2, last: &PoseSe2, spacing_secs: f64, beyond_secs: f64) -> PoseSe2 {
    let speed_mps = before.position.distance(last.position) / spacing_secs;
    let rate = angle::turn(before.heading_rad, last.heading_rad) / spacing_secs;
    let most = MOST_YAW_RATE_RADPS.min(speed_mps * 0.2);
    let turn = rate.clamp(-most, most) * beyond_secs;
    let way_m = speed_mps * beyond_secs;
    let chord = if turn.abs() > 1e-6 { (0.5 * turn).sin() / (0.5 * turn) * way_m } else { way_m };
    last.compose(&PoseSe2::new(chord * (0.5 * turn).cos(), chord * (0.5 * turn).sin(), turn))
}

//! A policy's answer, and how evenly spaced poses become a checked trajectory.

use ds_space::{PoseSe2, SimTime};
use ds_world::{Proposal, Trajectory, TrajectoryPoint};

use crate::Context;
use crate::error::PolicyError;

/// What a policy answers.
#[derive(Debug, Clone, PartialEq)]
pub struct PolicyAnswer {
    /// The trajectory to drive, in the rig frame of now.
    pub trajectory: Trajectory,
    /// All candidates, the answer among them; empty if the policy makes only one.
    pub proposals: Vec<Proposal>,
    /// What the policy attended to of the frames, if it tells with its answer.
    pub context: Option<Context>,
}

impl PolicyAnswer {
    /// Makes the answer of a policy that has one candidate.
    #[must_use]
    pub fn single(trajectory: Trajectory) -> Self {
        Self { trajectory, proposals: Vec::new(), context: None }
    }
}

/// Makes a trajectory of poses that are `dt` apart, the first one `dt` after now.
///
/// # Errors
/// [`PolicyError::Plan`] if a pose is not finite or there are too many.
pub fn evenly_spaced(name: &str, poses: &[PoseSe2], dt: SimTime) -> Result<Trajectory, PolicyError> {
    let points =
        poses.iter().zip(1i64..).map(|(pose, index)| TrajectoryPoint { after: SimTime(dt.0 * index), pose: *pose });
    Trajectory::new(points.collect()).map_err(|source| PolicyError::Plan { name: name.to_owned(), source })
}

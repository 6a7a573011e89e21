//! Topic `plan`: a trajectory and its proposals.

use ds_space::SimTime;
use ds_topic::body::Tensor;
use ds_topic::{Answered, Plan};
use ds_world::{Proposal, Trajectory, TrajectoryPoint};

use crate::error::FieldError;
use crate::field::{list, number, part, whole};
use crate::v1;

/// The most proposals of a plan.
pub const MAX_PROPOSALS: usize = 1_024;
/// The most numbers of a context.
pub const MAX_CONTEXT: usize = 4_096;
/// The most iterations of an episode.
const MAX_ITERATIONS: u32 = 20_000;
/// The most answers between two plans.
const MAX_ANSWERS: usize = 64;
/// The longest time that a policy takes: an hour.
const MAX_LATENCY_NANOS: i64 = 3_600_000_000_000;

impl From<&Trajectory> for v1::Trajectory {
    fn from(value: &Trajectory) -> Self {
        let pose =
            |point: &TrajectoryPoint| v1::TrajectoryPoint { after_ns: point.after.0, pose: Some((&point.pose).into()) };
        Self { poses: value.points().iter().map(pose).collect() }
    }
}

impl TryFrom<v1::TrajectoryPoint> for TrajectoryPoint {
    type Error = FieldError;
    fn try_from(message: v1::TrajectoryPoint) -> Result<Self, FieldError> {
        Ok(Self { after: SimTime(message.after_ns), pose: part("pose", message.pose)? })
    }
}

impl TryFrom<v1::Trajectory> for Trajectory {
    type Error = FieldError;
    fn try_from(message: v1::Trajectory) -> Result<Self, FieldError> {
        trajectory(list("poses", message.poses, ds_world::trajectory::MAX_POINTS)?)
    }
}

/// Takes a trajectory of its points.
pub(crate) fn trajectory(points: Vec<TrajectoryPoint>) -> Result<Trajectory, FieldError> {
    Trajectory::new(points).map_err(|error| FieldError::new("", format!("is refused: {error}")))
}

/// Takes what a policy attends to.
pub(crate) fn context(message: v1::Tensor) -> Result<Tensor, FieldError> {
    let numbers = message.values.len();
    if !(1..=MAX_CONTEXT).contains(&numbers) {
        return Err(FieldError::new("values", format!("has {numbers} elements, 1 to {MAX_CONTEXT} are allowed")));
    }
    if message.shape.len() != 2 {
        return Err(FieldError::new("shape", format!("is {:?}, tokens and channels expected", message.shape)));
    }
    Tensor::try_from(message)
}

impl From<&Proposal> for v1::Proposal {
    fn from(value: &Proposal) -> Self {
        Self { trajectory: Some((&value.trajectory).into()), score: Some(value.score) }
    }
}

impl TryFrom<v1::Proposal> for Proposal {
    type Error = FieldError;
    fn try_from(message: v1::Proposal) -> Result<Self, FieldError> {
        Ok(Self { trajectory: part("trajectory", message.trajectory)?, score: number("score", message.score)? })
    }
}

impl From<&Plan> for v1::Plan {
    fn from(value: &Plan) -> Self {
        Self {
            header: None,
            trajectory: Some((&value.trajectory).into()),
            proposals: value.proposals.iter().map(Into::into).collect(),
            observed_ns: value.observed.map(|time| time.0),
            answered: value.answered.as_ref().map(Into::into),
            context: value.context.as_ref().map(Into::into),
        }
    }
}

impl From<&Answered> for v1::Answered {
    fn from(value: &Answered) -> Self {
        let latency_ns = value.latency_nanos.iter().map(|nanos| i64::try_from(*nanos).unwrap_or(i64::MAX)).collect();
        Self { latency_ns, iterations_late: value.iterations_late }
    }
}

impl TryFrom<v1::Answered> for Answered {
    type Error = FieldError;
    fn try_from(message: v1::Answered) -> Result<Self, FieldError> {
        let answers = message.latency_ns.len();
        if answers > MAX_ANSWERS {
            return Err(FieldError::new("latency_ns", format!("has {answers} elements, the limit is {MAX_ANSWERS}")));
        }
        let nanos = |latency: i64| Ok(whole("latency_ns", latency, 0, MAX_LATENCY_NANOS)?.unsigned_abs());
        let latency_nanos = message.latency_ns.into_iter().map(nanos).collect::<Result<_, FieldError>>()?;
        let iterations_late = whole("iterations_late", message.iterations_late, 0, MAX_ITERATIONS)?;
        Ok(Self { latency_nanos, iterations_late })
    }
}

impl TryFrom<v1::Plan> for Plan {
    type Error = FieldError;
    fn try_from(message: v1::Plan) -> Result<Self, FieldError> {
        Ok(Self {
            trajectory: part("trajectory", message.trajectory)?,
            proposals: list("proposals", message.proposals, MAX_PROPOSALS)?,
            observed: message
                .observed_ns
                .map(|time| whole("observed_ns", time, 0, i64::MAX).map(SimTime))
                .transpose()?,
            answered: message.answered.map(|answered| part("answered", Some(answered))).transpose()?,
            context: message.context.map(context).transpose().map_err(|error| error.below("context"))?,
        })
    }
}

//! A planned trajectory: poses of the rig in the rig frame at planning time. Checked once, then trusted.

use ds_space::{PoseSe2, SimTime};

/// The most points that a trajectory may have.
pub const MAX_POINTS: usize = 256;
/// The longest horizon, in seconds.
pub const MAX_HORIZON_SECS: f64 = 30.0;
/// The farthest that a point may lie from the start, in metres.
pub const MAX_DISTANCE_M: f64 = 2_000.0;

/// One pose of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrajectoryPoint {
    /// Time after the plan's tick; positive and increasing.
    pub after: SimTime,
    /// Pose of the rig in the rig frame at the plan's tick.
    pub pose: PoseSe2,
}

/// A trajectory with at least one point, finite, strictly forwards in time and within bounds.
#[derive(Debug, Clone, PartialEq)]
pub struct Trajectory(Vec<TrajectoryPoint>);

/// One candidate of a plan.
#[derive(Debug, Clone, PartialEq)]
pub struct Proposal {
    /// The trajectory.
    pub trajectory: Trajectory,
    /// The policy's own score; larger is better.
    pub score: f64,
}

/// Says why a trajectory is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrajectoryError {
    /// No points.
    #[error("trajectory has no points")]
    Empty,
    /// Too many points.
    #[error("trajectory has {points} points, the limit is {MAX_POINTS}")]
    TooLong {
        /// How many points came.
        points: usize,
    },
    /// A number is NaN or infinite.
    #[error("field \"poses[{index}].{field}\" is {value}")]
    NotFinite {
        /// Which point.
        index: usize,
        /// Which field.
        field: &'static str,
        /// The value.
        value: f64,
    },
    /// A time does not come after the one before it (or after 0).
    #[error("field \"poses[{index}].after\" is {after_secs} s, not after {previous_secs} s")]
    Backwards {
        /// Which point.
        index: usize,
        /// Its time, in seconds.
        after_secs: f64,
        /// The time before it, in seconds.
        previous_secs: f64,
    },
    /// A time lies beyond [`MAX_HORIZON_SECS`].
    #[error("field \"poses[{index}].after\" is {after_secs} s, the limit is {MAX_HORIZON_SECS} s")]
    BeyondHorizon {
        /// Which point.
        index: usize,
        /// Its time, in seconds.
        after_secs: f64,
    },
    /// A position lies beyond [`MAX_DISTANCE_M`].
    #[error("field \"poses[{index}]\" lies {distance_m} m away, the limit is {MAX_DISTANCE_M} m")]
    TooFar {
        /// Which point.
        index: usize,
        /// Its distance, in metres.
        distance_m: f64,
    },
}

impl Trajectory {
    /// Checks the points of a plan.
    ///
    /// # Errors
    /// [`TrajectoryError`] names the first bad field.
    pub fn new(points: Vec<TrajectoryPoint>) -> Result<Self, TrajectoryError> {
        if points.is_empty() {
            return Err(TrajectoryError::Empty);
        }
        if points.len() > MAX_POINTS {
            return Err(TrajectoryError::TooLong { points: points.len() });
        }
        let mut previous = SimTime(0);
        for (index, point) in points.iter().enumerate() {
            check_point(index, point, previous)?;
            previous = point.after;
        }
        Ok(Self(points))
    }

    /// Returns the points, in time order.
    #[must_use]
    pub fn points(&self) -> &[TrajectoryPoint] {
        &self.0
    }

    /// Returns the time of the last point.
    #[must_use]
    pub fn horizon(&self) -> SimTime {
        self.0.last().map_or(SimTime(0), |point| point.after)
    }

    /// Returns the planned pose at a time, linear between points from the rig's own pose at time 0, the last pose held.
    #[must_use]
    pub fn at(&self, after: SimTime) -> PoseSe2 {
        let mut from = TrajectoryPoint { after: SimTime(0), pose: PoseSe2::default() };
        for to in &self.0 {
            if after <= to.after {
                let share = (after - from.after).secs() / (to.after - from.after).secs();
                return from.pose.lerp(&to.pose, share);
            }
            from = *to;
        }
        from.pose
    }
}

fn check_point(index: usize, point: &TrajectoryPoint, previous: SimTime) -> Result<(), TrajectoryError> {
    let pose = &point.pose;
    let fields = [("x_m", pose.position.x), ("y_m", pose.position.y), ("heading_rad", pose.heading_rad)];
    for (field, value) in fields {
        if !value.is_finite() {
            return Err(TrajectoryError::NotFinite { index, field, value });
        }
    }
    let after_secs = point.after.secs();
    if point.after <= previous {
        return Err(TrajectoryError::Backwards { index, after_secs, previous_secs: previous.secs() });
    }
    if after_secs > MAX_HORIZON_SECS {
        return Err(TrajectoryError::BeyondHorizon { index, after_secs });
    }
    let distance_m = pose.position.length();
    if distance_m > MAX_DISTANCE_M {
        return Err(TrajectoryError::TooFar { index, distance_m });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(secs: f64, x_m: f64) -> TrajectoryPoint {
        TrajectoryPoint { after: SimTime::from_secs(secs), pose: PoseSe2::new(x_m, 0.0, 0.0) }
    }

    fn refused(points: Vec<TrajectoryPoint>, says: &str) {
        let error = Trajectory::new(points).expect_err(says).to_string();
        assert!(error.contains(says), "{error:?} does not say {says:?}");
    }

    #[test]
    fn refuses_with_the_name_of_the_field() {
        refused(vec![], "no points");
        refused(vec![point(0.1, 0.0); 300], "300 points");
        refused(vec![point(0.5, 1.0), point(1.0, f64::NAN)], "poses[1].x_m");
        refused(vec![point(1.0, 1.0), point(0.5, 2.0)], "poses[1].after");
        refused(vec![point(0.0, 1.0)], "poses[0].after");
        refused(vec![point(31.0, 1.0)], "limit is 30 s");
        refused(vec![point(1.0, 1e9)], "limit is 2000 m");
    }

    #[test]
    fn interpolates_from_the_rig_and_holds_the_end() {
        let plan = Trajectory::new(vec![point(0.5, 5.0), point(1.0, 9.0)]).expect("the plan is sound");
        for (secs, x_m) in [(0.0, 0.0), (0.25, 2.5), (0.75, 7.0), (3.0, 9.0)] {
            assert!((plan.at(SimTime::from_secs(secs)).position.x - x_m).abs() < 1e-9);
        }
    }
}

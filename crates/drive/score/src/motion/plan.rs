//! A plan as a policy gives it, and its 41 reference poses at 10 Hz.
//!
//! Positions and unwrapped headings are linear between poses, from the ego's own pose at time 0; beyond the last pose
//! it is held. Times are truncated to whole microseconds (NAV `evaluate/pdm_score.py:26-82`).

use ds_space::PoseSe2;
use ds_space::angle::wrap;
use ds_world::Trajectory;

use crate::constants::horizon::{DT_S, MICROS, STATES, STEPS};
use crate::error::ScoreError;

const MOST_POSES: usize = 4096;
const SHORTEST_DT_S: f64 = 1e-3;

/// Poses of the rear axle in the ego's rear-axle frame now; the first one is at `dt_s`.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedPoses {
    /// Time between poses, in seconds.
    pub dt_s: f64,
    /// The poses, x forward, y left, in metres and radians.
    pub poses: Vec<PoseSe2>,
}

/// How a plan covers the scored 4 s.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Coverage {
    /// It ends with them.
    Whole,
    /// It ends before; its last pose is held.
    Held,
    /// It goes on; the rest is not scored.
    Cut,
}

impl PlannedPoses {
    /// Makes a plan of a checked trajectory, sampled at 10 Hz over the scored 4 s.
    #[must_use]
    pub fn of(trajectory: &Trajectory) -> Self {
        let at = |step: usize| trajectory.at(ds_space::SimTime::from_secs(step as f64 * DT_S));
        Self { dt_s: DT_S, poses: (1..=STEPS).map(at).collect() }
    }

    /// Returns how the plan covers the scored 4 s.
    #[must_use]
    pub fn coverage(&self) -> Coverage {
        let end_micros = micros(self.dt_s * self.poses.len() as f64 + 0.5 / MICROS);
        match end_micros.cmp(&micros(STEPS as f64 * DT_S)) {
            std::cmp::Ordering::Less => Coverage::Held,
            std::cmp::Ordering::Equal => Coverage::Whole,
            std::cmp::Ordering::Greater => Coverage::Cut,
        }
    }

    /// Checks that the plan can be sampled.
    ///
    /// # Errors
    /// [`ScoreError::BadPlan`] or [`ScoreError::NotFinite`].
    pub fn check(&self) -> Result<(), ScoreError> {
        if self.poses.is_empty()
            || self.poses.len() > MOST_POSES
            || !(self.dt_s >= SHORTEST_DT_S && self.dt_s.is_finite())
        {
            return Err(ScoreError::BadPlan { poses: self.poses.len(), dt_s: self.dt_s });
        }
        for (index, pose) in self.poses.iter().enumerate().filter(|(_, pose)| !pose.is_finite()) {
            for (name, value) in [("x", pose.position.x), ("y", pose.position.y), ("heading", pose.heading_rad)] {
                crate::error::finite(value, || format!("poses[{index}].{name}"))?;
            }
        }
        Ok(())
    }

    /// Writes the reference poses in the world, headings unwrapped, for an ego at a pose.
    pub(crate) fn sample(&self, ego: &PoseSe2, out: &mut [PoseSe2; STATES]) -> Result<(), ScoreError> {
        self.check()?;
        let (forward, left) = (ego.forward(), ego.left());
        let mut from = (0i64, *ego);
        let mut next_step = 0;
        for (index, pose) in self.poses.iter().enumerate() {
            // As the reference sums: index · dt, then + dt.
            let at = micros(index as f64 * self.dt_s + self.dt_s);
            let world = PoseSe2 {
                position: ego.position + forward * pose.position.x + left * pose.position.y,
                heading_rad: from.1.heading_rad + wrap(ego.heading_rad + pose.heading_rad - from.1.heading_rad),
            };
            while next_step < STATES && step_micros(next_step) <= at {
                let share = (step_micros(next_step) - from.0) as f64 / (at - from.0) as f64;
                out[next_step] = between(&from.1, &world, share);
                next_step += 1;
            }
            if next_step == STATES {
                return Ok(());
            }
            from = (at, world);
        }
        out[next_step..].fill(from.1);
        Ok(())
    }
}

fn between(from: &PoseSe2, to: &PoseSe2, share: f64) -> PoseSe2 {
    PoseSe2 {
        position: from.position + (to.position - from.position) * share,
        heading_rad: from.heading_rad + (to.heading_rad - from.heading_rad) * share,
    }
}

#[expect(clippy::cast_possible_truncation, reason = "truncation is the rule; casts saturate")]
fn micros(secs: f64) -> i64 {
    (secs * MICROS) as i64
}

fn step_micros(step: usize) -> i64 {
    micros(step as f64 * DT_S)
}

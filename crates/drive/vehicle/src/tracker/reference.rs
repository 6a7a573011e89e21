//! A plan as poses in the world, one per tick from the tick of the plan on.

use ds_space::{PoseSe2, SimTime};
use ds_world::Trajectory;

/// The planned poses p_0 (where the ego was) to p_n, one tick apart, world frame.
#[derive(Debug, Clone)]
pub struct Reference {
    pub(super) poses: Vec<PoseSe2>,
    pub(super) dt_secs: f64,
}

impl Reference {
    /// Samples a plan, anchored at the pose of the ego when it was made, at every tick of its horizon.
    #[must_use]
    pub fn new(plan: &Trajectory, anchor: PoseSe2, dt: SimTime) -> Self {
        let steps = (plan.horizon().0 / dt.0).max(1);
        let poses = (0..=steps)
            .map(|step| if step == 0 { anchor } else { anchor.compose(&plan.at(SimTime(step * dt.0))) })
            .collect();
        Self { poses, dt_secs: dt.secs() }
    }

    /// Returns how many displacements there are.
    pub(super) fn steps(&self) -> usize {
        self.poses.len() - 1
    }

    /// Returns the pose of a step, the last one held.
    pub(super) fn pose(&self, step: usize) -> &PoseSe2 {
        &self.poses[step.min(self.poses.len() - 1)]
    }
}

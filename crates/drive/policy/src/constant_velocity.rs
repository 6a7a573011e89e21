//! The blind baseline: goes on straight ahead at the present speed, and never backwards.

use ds_space::PoseSe2;

use crate::error::PolicyError;
use crate::observation::{Observation, PrivilegedView};
use crate::plan::{PolicyAnswer, evenly_spaced};
use crate::{Policy, Restart};

/// The policy's name.
pub const NAME: &str = "constant-velocity";

/// Drives straight ahead at the present speed.
#[derive(Debug, Clone, Copy, Default)]
pub struct ConstantVelocity;

impl Policy for ConstantVelocity {
    fn name(&self) -> &str {
        NAME
    }

    fn privileged(&self) -> bool {
        false
    }

    fn plan(&mut self, observation: &Observation, _: Option<&PrivilegedView>) -> Result<PolicyAnswer, PolicyError> {
        observation.check()?;
        let step_m = observation.ego.speed_mps.max(0.0) * observation.dt.secs();
        let poses: Vec<PoseSe2> =
            (1..=observation.horizon_ticks).map(|k| PoseSe2::new(step_m * f64::from(k), 0.0, 0.0)).collect();
        Ok(PolicyAnswer::single(evenly_spaced(NAME, &poses, observation.dt)?))
    }

    fn restart(&self) -> Restart {
        Restart::Stateless
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::observation::EgoView;
    use ds_space::{Draws, SimTime};

    fn observation(speed_mps: f64, horizon_ticks: u32) -> Observation {
        Observation {
            frames: vec![],
            cameras: vec![],
            ego: EgoView { speed_mps, ..EgoView::default() },
            command: ds_world::RouteCommand::Straight,
            stamps: vec![SimTime(0)],
            horizon_ticks,
            dt: SimTime::from_secs(0.1),
            draw: Draws::from_seed(0, "test"),
        }
    }

    #[test]
    fn goes_on_straight_ahead() {
        for (speed_mps, ends_at_m) in [(10.0, 80.0), (0.0, 0.0), (-1.0, 0.0)] {
            let answer = ConstantVelocity.plan(&observation(speed_mps, 80), None).expect("plans");
            assert_eq!(answer.trajectory.points().len(), 80);
            let end = answer.trajectory.at(SimTime::from_secs(8.0));
            assert!((end.position.x - ends_at_m).abs() < 1e-9 && end.position.y == 0.0, "{end:?}");
        }
    }

    #[test]
    fn refuses_bad_observations_by_field() {
        for (speed_mps, horizon, says) in [(f64::NAN, 80, "ego"), (1.0, 0, "horizon_ticks"), (1.0, 9_999, "9999")] {
            let error = ConstantVelocity.plan(&observation(speed_mps, horizon), None).expect_err(says).to_string();
            assert!(error.contains(says), "{error:?} does not say {says:?}");
        }
    }
}

//! How a plan is executed: plan → 41 reference poses → LQR tracker + kinematic bicycle → 41 states (`scoring.md` §2).
//!
//! Every plan that is scored runs through here, the reference and the human plan too. World frame, SI units. The control law
//! is that of `ds_vehicle`, which the simulator's tracker shares; the car is the reference implementation's kinematic
//! bicycle, and the profiles are solved for its fixed 40 steps.

mod bicycle;
mod lqr;
mod plan;
mod profile;
mod state;

pub use plan::{Coverage, PlannedPoses};
pub use state::VehicleState;

use ds_space::PoseSe2;

use crate::constants::horizon::{STATES, STEPS};
use crate::constants::navsim_car;
use crate::error::ScoreError;

use self::profile::SpeedFit;

/// The executed states of a plan, one per 0.1 s, the first being the true state now.
pub type Executed = [VehicleState; STATES];

/// The simulation that executes plans; what does not depend on the plan is prepared once.
#[derive(Debug, Clone)]
pub struct Executor {
    speed_fit: &'static SpeedFit,
    wheel_base_m: f64,
}

impl Default for Executor {
    fn default() -> Self {
        Self::new(navsim_car::WHEEL_BASE_M)
    }
}

impl Executor {
    /// Prepares the simulation of a car with this wheelbase, in metres.
    #[must_use]
    pub fn new(wheel_base_m: f64) -> Self {
        Self { speed_fit: SpeedFit::get(), wheel_base_m }
    }

    /// Executes a plan from a state.
    ///
    /// # Errors
    /// [`ScoreError`] if the plan cannot be sampled or holds a number that is not finite.
    pub fn execute(&self, start: &VehicleState, plan: &PlannedPoses) -> Result<Executed, ScoreError> {
        let mut states = [VehicleState::default(); STATES];
        self.execute_into(start, plan, &mut states)?;
        Ok(states)
    }

    /// As [`Self::execute`], into memory of the caller.
    ///
    /// # Errors
    /// As [`Self::execute`].
    pub fn execute_into(
        &self,
        start: &VehicleState,
        plan: &PlannedPoses,
        states: &mut Executed,
    ) -> Result<(), ScoreError> {
        let mut poses = [PoseSe2::default(); STATES];
        plan.sample(&start.pose(), &mut poses)?;
        let directions = profile::directions(&poses);
        let speeds = self.speed_fit.speeds(&poses, &directions);
        let curvatures = profile::curvatures(&poses, &speeds);
        let reference =
            lqr::Reference { poses: &poses, directions: &directions, speeds: &speeds, curvatures: &curvatures };
        states[0] = *start;
        for step in 0..STEPS {
            let command = lqr::command(&reference, step, &states[step], self.wheel_base_m);
            states[step + 1] = bicycle::step(&states[step], command, self.wheel_base_m);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;

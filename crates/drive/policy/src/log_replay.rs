//! Privileged: plans the recorded drive of the expert, seen from where the ego is now.

use ds_space::{PoseSe2, Tick};

use crate::error::PolicyError;
use crate::observation::{Observation, PrivilegedView};
use crate::plan::PolicyAnswer;
use crate::{Policy, Restart};

/// The policy's name.
pub const NAME: &str = ds_world::Anchor::LogReplay.name();

/// Repeats the expert's drive.
#[derive(Debug, Clone, Copy, Default)]
pub struct LogReplay;

impl Policy for LogReplay {
    fn name(&self) -> &str {
        NAME
    }

    fn privileged(&self) -> bool {
        true
    }

    fn plan(
        &mut self,
        observation: &Observation,
        privileged: Option<&PrivilegedView>,
    ) -> Result<PolicyAnswer, PolicyError> {
        observation.check()?;
        let view = privileged.ok_or(PolicyError::NeedsPrivilege { name: NAME })?;
        let driven: Vec<PoseSe2> = (1..=observation.horizon_ticks).map(|k| logged(view, view.tick.plus(k))).collect();
        view.answer(NAME, &driven, observation.dt)
    }

    fn restart(&self) -> Restart {
        Restart::Stateless
    }
}

/// Returns the logged pose; past the end of the log the last speed and heading go on.
fn logged(view: &PrivilegedView, tick: Tick) -> PoseSe2 {
    let state = view.scene.logged_ego(tick);
    let beyond = tick.0.saturating_sub(view.scene.last_tick().0);
    let ahead_m = state.speed_mps().max(0.0) * view.scene.dt.secs() * f64::from(beyond);
    state.pose.compose(&PoseSe2::new(ahead_m, 0.0, 0.0))
}

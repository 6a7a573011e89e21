//! Privileged: follows the route by IDM behind whoever is in its way now (see [`crate::driver`]), and stops at red lights.
//!
//! It foresees nobody: who is not in the way yet does not count.

use ds_world::Anchor;

use crate::driver::Kept;
use crate::error::PolicyError;
use crate::observation::{Observation, PrivilegedView};
use crate::plan::PolicyAnswer;
use crate::{Policy, Restart};

/// The policy's name.
pub const NAME: &str = Anchor::Idm.name();

/// Follows the route behind others as they are.
#[derive(Debug, Default)]
pub struct Idm {
    driver: Kept,
}

impl Policy for Idm {
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
        let (_, now) = view.live(NAME)?;
        let driven = self.driver.of(&view.scene).drive_live(now, &view.ego, observation.horizon_ticks);
        view.answer(NAME, &driven, observation.dt)
    }

    fn restart(&self) -> Restart {
        Restart::Stateless
    }
}

//! Privileged: follows the route with the speed of a careful driver (see [`crate::driver`]).

use crate::driver::Kept;
use crate::error::PolicyError;
use crate::observation::{Observation, PrivilegedView};
use crate::plan::PolicyAnswer;
use crate::{Policy, Restart};

/// The policy's name.
pub const NAME: &str = ds_world::Anchor::RouteFollower.name();

/// Follows the route behind others and stops at red lights.
#[derive(Debug, Default)]
pub struct RouteFollower {
    driver: Kept,
}

impl Policy for RouteFollower {
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
        let driven = self.driver.of(&view.scene).drive(&view.ego, view.tick, observation.horizon_ticks);
        view.answer(NAME, &driven, observation.dt)
    }

    fn restart(&self) -> Restart {
        Restart::Stateless
    }
}

//! Privileged: follows the route with the speed of a careful driver (see [`crate::driver`]).

use ds_space::PoseSe2;

use crate::driver::Driver;
use crate::error::PolicyError;
use crate::observation::{Observation, PrivilegedView};
use crate::plan::{PolicyAnswer, evenly_spaced};
use crate::{Policy, Restart};

/// The policy's name.
pub const NAME: &str = "route-follower";

/// Follows the route behind others and stops at red lights.
#[derive(Debug, Default)]
pub struct RouteFollower {
    /// The prepared scenario, kept between requests because preparing is dear; it holds no state of the drive.
    driver: Option<Driver>,
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
        let prepared = self.driver.take().filter(|driver| driver.scenario() == view.scene.digest);
        let driver = self.driver.insert(prepared.unwrap_or_else(|| Driver::new(&view.scene)));
        let driven = driver.drive(&view.ego, view.tick, observation.horizon_ticks);
        let poses: Vec<PoseSe2> = driven.iter().map(|pose| view.ego.pose.relative(pose)).collect();
        Ok(PolicyAnswer::single(evenly_spaced(NAME, &poses, observation.dt)?))
    }

    fn restart(&self) -> Restart {
        Restart::Stateless
    }
}

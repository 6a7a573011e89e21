//! Privileged: follows the route with the speed of a careful driver (see [`crate::driver`]).

use ds_space::PoseSe2;
use ds_world::Anchor;

use crate::anchor::Anchored;
use crate::driver::Kept;
use crate::error::PolicyError;
use crate::observation::PrivilegedView;

/// Follows the route behind others and stops at red lights.
#[derive(Debug, Default)]
pub struct RouteFollower {
    driver: Kept,
}

impl Anchored for RouteFollower {
    const NAME: &'static str = Anchor::RouteFollower.name();

    fn driven(&mut self, view: &PrivilegedView, horizon_ticks: u32) -> Result<Vec<PoseSe2>, PolicyError> {
        Ok(self.driver.of(&view.scene).drive(&view.ego, view.tick, horizon_ticks))
    }
}

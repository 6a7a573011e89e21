//! Privileged: follows the route by IDM behind whoever is in its way now (see [`crate::driver`]), and stops at red lights.
//!
//! It foresees nobody: who is not in the way yet does not count.

use ds_space::PoseSe2;
use ds_world::Anchor;

use crate::anchor::Anchored;
use crate::driver::Kept;
use crate::error::PolicyError;
use crate::observation::PrivilegedView;

/// Follows the route behind others as they are.
#[derive(Debug, Default)]
pub struct Idm {
    driver: Kept,
}

impl Anchored for Idm {
    const NAME: &'static str = Anchor::Idm.name();

    fn driven(&mut self, view: &PrivilegedView, horizon_ticks: u32) -> Result<Vec<PoseSe2>, PolicyError> {
        let (_, now) = view.live(Self::NAME)?;
        Ok(self.driver.of(&view.scene).drive_live(now, &view.ego, horizon_ticks))
    }
}

//! Privileged: plans the recorded drive of the expert, seen from where the ego is now.

use ds_space::{PoseSe2, Tick};
use ds_world::Anchor;

use crate::anchor::Anchored;
use crate::error::PolicyError;
use crate::observation::PrivilegedView;

/// Repeats the expert's drive.
#[derive(Debug, Clone, Copy, Default)]
pub struct LogReplay;

impl Anchored for LogReplay {
    const NAME: &'static str = Anchor::LogReplay.name();

    fn driven(&mut self, view: &PrivilegedView, horizon_ticks: u32) -> Result<Vec<PoseSe2>, PolicyError> {
        Ok((1..=horizon_ticks).map(|k| logged(view, view.tick.plus(k))).collect())
    }
}

/// Returns the logged pose; past the end of the log the last speed and heading go on.
fn logged(view: &PrivilegedView, tick: Tick) -> PoseSe2 {
    let state = view.scene.logged_ego(tick);
    let beyond = tick.0.saturating_sub(view.scene.last_tick().0);
    let ahead_m = state.speed_mps().max(0.0) * view.scene.dt.secs() * f64::from(beyond);
    state.pose.compose(&PoseSe2::new(ahead_m, 0.0, 0.0))
}

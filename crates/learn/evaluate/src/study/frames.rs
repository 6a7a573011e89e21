//! The frames of a scenario from each source: the same moments, seen from the same places.
//!
//! Scenarios of odd number stay on the log. The others are displaced by up to ±1 m and ±5°, drawn once and reached by
//! frame 8, so that no source can show the log's own pictures. All start on the log, as drives do.

use std::sync::Arc;

use ds_camera::{Appearance, PlainCamera, ReferenceWorld};
use ds_raster::RgbImage;
use ds_space::{Draws, PoseSe2};
use ds_world::{Scene, WorldState};

use super::config::Source;
use crate::arm::Arm;
use crate::drive::{Drive, Route};
use crate::error::AppraisalError;

/// The frame by which a displaced drive has left the log.
const REACHED: u32 = 8;

/// A scenario with the place that it is seen from.
pub(crate) struct Take {
    pub(crate) scene: Arc<Scene>,
    pub(crate) look: Appearance,
    /// To the left in metres, to the left in radians.
    pub(crate) displaced: [f64; 2],
}

impl Take {
    /// Displaces every second scenario.
    pub(crate) fn new(index: u64, scene: Arc<Scene>, look: Appearance) -> Self {
        let draws = Draws::new(&scene.digest, "fidelity displacement", &[]);
        let most = if index.is_multiple_of(2) { [1.0, 5f64.to_radians()] } else { [0.0, 0.0] };
        let displaced = [draws.range(0, -most[0], most[0]), draws.range(1, -most[1], most[1])];
        Self { scene, look, displaced }
    }

    /// Prepares the drive.
    pub(crate) fn drive(&self, size_px: (u32, u32)) -> Result<Drive, AppraisalError> {
        let route = Route { scene: Arc::clone(&self.scene), start: 0, pace: 1.0, look: self.look };
        Drive::new(&ReferenceWorld, &route, size_px)
    }

    /// Returns the world of a frame with its car displaced.
    fn world(&self, drive: &Drive, frame: u32) -> WorldState {
        let mut world = drive.world(frame);
        let share = f64::from(frame.min(REACHED)) / f64::from(REACHED);
        let share = share * share * (3.0 - 2.0 * share);
        let [left_m, heading_rad] = self.displaced.map(|most| share * most);
        world.ego.pose = world.ego.pose.compose(&PoseSe2::new(0.0, left_m, heading_rad));
        world
    }

    /// Makes frames 0 to `last` as a source shows them.
    ///
    /// # Errors
    /// If a frame cannot be rendered or the video model gives values that are not finite.
    pub(crate) fn frames(
        &self,
        source: Source,
        arm: Option<&Arm>,
        drive: &mut Drive,
        last: u32,
    ) -> Result<Vec<RgbImage>, AppraisalError> {
        let worlds: Vec<WorldState> = (0..=last).map(|frame| self.world(drive, frame)).collect();
        match (source, arm) {
            (Source::Reference, _) => worlds.iter().map(|world| drive.frame_of(world)).collect(),
            (Source::SimRgb, _) => {
                let camera = PlainCamera::new(&self.scene);
                let rig = |world: &WorldState| world.ego.pose.world_from_rig(0.0);
                worlds.iter().map(|world| Ok(camera.render(world, &drive.model, rig(world))?)).collect()
            }
            (Source::Layout, _) => worlds.iter().map(|world| drive.layout_of(world)).collect(),
            (Source::Dreamstream, arm) => {
                let arm = arm.ok_or_else(|| AppraisalError::config("video", "is needed by source \"dreamstream\""))?;
                let layouts: Vec<RgbImage> =
                    worlds.iter().map(|world| drive.layout_of(world)).collect::<Result<_, _>>()?;
                arm.roll_with(drive, &layouts)
            }
        }
    }
}

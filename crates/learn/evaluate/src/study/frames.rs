//! The frames of a scenario from each source: the same moments, seen from the same places.
//!
//! Scenarios of odd number stay on the log. The others are displaced by up to ±1 m and ±5°, drawn once and reached by
//! frame 8, so that no source can show the log's own pictures. All start on the log, as drives do.

use std::sync::Arc;

use ds_camera::{Appearance, CameraWorld, PlainCamera, ReprojectedCamera, SceneCamera};
use ds_raster::RgbImage;
use ds_second_camera::SecondCamera;
use ds_space::{Draws, PoseSe2};
use ds_topic::ObservationSource;
use ds_video::Layout;
use ds_world::{Scene, WorldState};

use super::config::StudyConfig;
use super::source::Source;
use crate::arm::Arm;
use crate::drive::{Drive, Route};
use crate::error::EvaluationError;

/// The frame by which a displaced drive has left the log.
const REACHED: u32 = 8;

/// A scenario with the place that it is seen from.
pub(crate) struct Take {
    pub(crate) scene: Arc<Scene>,
    pub(crate) look: Appearance,
    /// To the left in metres, to the left in radians.
    pub(crate) displaced: [f64; 2],
    world_of: &'static dyn CameraWorld,
    /// Ticks of the log per frame.
    pace: f64,
}

impl Take {
    /// Displaces every second scenario.
    pub(crate) fn new(config: &StudyConfig, index: u64, scene: Arc<Scene>, look: Appearance) -> Self {
        let draws = Draws::new(&scene.digest, "fidelity displacement", &[]);
        let most = if index.is_multiple_of(2) { [1.0, 5f64.to_radians()] } else { [0.0, 0.0] };
        let displaced = [draws.range(0, -most[0], most[0]), draws.range(1, -most[1], most[1])];
        Self { scene, look, displaced, world_of: config.world.world(), pace: config.pace }
    }

    /// Prepares the drive as a source shows it.
    pub(crate) fn drive(&self, source: &Source, size_px: (u32, u32)) -> Result<Drive, EvaluationError> {
        let scene = Arc::new(source.scene(&self.scene));
        let look = source.altered.look.as_deref().map_or(Ok(self.look), Appearance::named);
        let mut look = look.map_err(|error| EvaluationError::config("sources.look", error.to_string()))?;
        look.palette_seed = look.palette_seed.wrapping_add(source.altered.paint);
        let route = Route { scene, start: 0, pace: self.pace, look, turned_deg: 0.0 };
        Drive::new(self.world_of, &route, size_px)
    }

    /// Returns the world of a frame with its car displaced.
    pub(crate) fn world(&self, drive: &Drive, frame: u32) -> WorldState {
        let mut world = drive.world(frame);
        let share = f64::from(frame.min(REACHED)) / f64::from(REACHED);
        let share = share * share * (3.0 - 2.0 * share);
        let [left_m, heading_rad] = self.displaced.map(|most| share * most);
        world.ego.pose = world.ego.pose.compose(&PoseSe2::new(0.0, left_m, heading_rad));
        world
    }

    /// Makes frames 0 to `last` as a source shows them, of the drive that it prepared.
    ///
    /// # Errors
    /// If a frame cannot be rendered or the video model gives values that are not finite.
    pub(crate) fn frames(
        &self,
        source: &Source,
        arm: Option<&Arm>,
        drive: &mut Drive,
        last: u32,
    ) -> Result<Vec<RgbImage>, EvaluationError> {
        let told = drive.model.clone();
        drive.model = source.camera(&told);
        let made = self.made(source, arm, drive, last);
        drive.model = told;
        let picture = |(frame, image)| source.picture(&self.scene, frame, image);
        Ok((0..).zip(made?).map(picture).collect())
    }

    fn made(
        &self,
        source: &Source,
        arm: Option<&Arm>,
        drive: &mut Drive,
        last: u32,
    ) -> Result<Vec<RgbImage>, EvaluationError> {
        let age = source.altered.old_ticks;
        let worlds: Vec<WorldState> =
            (0..=last).map(|frame| source.world(&self.scene, self.world(drive, frame.saturating_sub(age)))).collect();
        let model = drive.model.clone();
        let seen = |camera: &dyn SceneCamera| -> Result<Vec<RgbImage>, EvaluationError> {
            worlds.iter().map(|world| Ok(camera.on_ego(world, &model)?)).collect()
        };
        match source.from {
            ObservationSource::Reference => worlds.iter().map(|world| drive.frame_of(world)).collect(),
            // The log's own frame, whatever the car does.
            ObservationSource::Logged => (0..=last).map(|frame| drive.frame(frame)).collect(),
            ObservationSource::SimRgb => seen(&PlainCamera::new(drive.scene())),
            ObservationSource::Reprojected => seen(&ReprojectedCamera::new(Arc::new(drive.scene().clone()), self.look)),
            ObservationSource::SecondCamera => seen(&SecondCamera::new(drive.scene(), &self.look)),
            ObservationSource::Layout => worlds.iter().map(|world| Ok(drive.layout_of(world)?.image)).collect(),
            generated => {
                let arm = arm.ok_or_else(|| {
                    EvaluationError::config("video", format!("is needed by source {:?}", generated.name()))
                })?;
                let layouts: Vec<Layout> =
                    worlds.iter().map(|world| drive.layout_of(world)).collect::<Result<_, _>>()?;
                arm.roll_from(drive, drive.frame_of(&worlds[0])?, &layouts)
            }
        }
    }
}

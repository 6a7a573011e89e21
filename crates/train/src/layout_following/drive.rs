//! A held-out drive along its log: reference frames, class maps and layouts of the same ticks and poses.
//!
//! Scenario seeds from [`FIRST_SEED`] on, which no training uses; the families take turns and the look is drawn as in
//! training.

use ds_camera::{Appearance, PixelClass, ReferenceCamera};
use ds_layout::{BackendChoice, LayoutScene, Renderer, StaticMap};
use ds_raster::RgbImage;
use ds_scenario::Family;
use ds_space::{Digest, Draws, Tick};

use crate::error::TrainError;

/// Scenario seeds of measured drives begin here.
pub const FIRST_SEED: u64 = 2_000_000;

/// All that is known of a drive; index 0 is tick 0.
pub struct Drive {
    /// The scenario's family.
    pub family: &'static str,
    /// The scenario's seed.
    pub seed: u64,
    /// Keys the model's noise.
    pub draw_key: Digest,
    /// The look in words.
    pub prompt: String,
    /// What the reference camera saw.
    pub frames: Vec<RgbImage>,
    /// What each pixel of those frames shows.
    pub classes: Vec<Vec<PixelClass>>,
    /// The layouts.
    pub layouts: Vec<RgbImage>,
    /// The layouts as if there were no agents.
    pub layouts_without_agents: Vec<RgbImage>,
}

impl Drive {
    /// Renders ticks 0 to `last_tick` of the held-out scenario of an index.
    ///
    /// # Errors
    /// If the scenario has no camera or a layout cannot be rendered.
    pub fn held_out(index: u64, (width_px, height_px): (u32, u32), last_tick: u32) -> Result<Self, TrainError> {
        let seed = FIRST_SEED + index;
        let family = Family::ALL[(index % Family::ALL.len() as u64) as usize];
        let refuse = |reason: String| TrainError::Clip { index, reason };
        let scene = ds_scenario::generate(family, seed);
        let appearance = Appearance::from_seed(Draws::from_seed(seed, "measured look").u64(0));
        let camera = ReferenceCamera::new(&scene, appearance);
        let map = StaticMap::new(&scene.map);
        let mut renderer = Renderer::new(BackendChoice::Cpu).map_err(|error| refuse(error.to_string()))?;
        let mut model = scene.cameras.first().cloned().ok_or_else(|| refuse("no camera".to_owned()))?;
        model.intrinsics = model.intrinsics.resized(width_px, height_px);
        let mut drive = Self {
            family: family.name(),
            seed,
            draw_key: Draws::key(&scene.digest, &appearance.prompt(), 0),
            prompt: appearance.prompt(),
            frames: Vec::new(),
            classes: Vec::new(),
            layouts: Vec::new(),
            layouts_without_agents: Vec::new(),
        };
        for tick in 0..=last_tick {
            let mut world = scene.logged_world(Tick(tick));
            let world_from_rig = world.ego.pose.world_from_rig(0.0);
            drive.frames.push(camera.render(&world, &model, world_from_rig));
            drive.classes.push(camera.classes(&world, &model, world_from_rig));
            let mut layout = |world: &_| {
                let scene = LayoutScene { map: &map, world };
                renderer.render(&scene, &model, world_from_rig).map_err(|error| refuse(error.to_string()))
            };
            drive.layouts.push(layout(&world)?);
            world.agents.clear();
            drive.layouts_without_agents.push(layout(&world)?);
        }
        Ok(drive)
    }
}

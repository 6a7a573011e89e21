//! Training clips: generated scenarios seen by the reference camera and as layouts, from an ego that strays.
//!
//! The ego starts at a drawn tick of the expert's drive and follows it at another speed, on a drawn lateral offset
//! that drifts with a drawn heading error, so that the model sees what a policy under test will show it. Sun, clouds,
//! haze, wetness and night are drawn by the appearance's own distribution.

use ds_camera::{Appearance, ReferenceCamera, Sampling};
use ds_layout::{BackendChoice, LayoutScene, Renderer, StaticMap};
use ds_scenario::Family;
use ds_space::{DVec2, Draws, PoseSe2, Tick, angle};
use ds_world::{EgoState, Scene};

use crate::Progress;
use crate::batch;
use crate::clips::{Clip, ClipShape, ClipSource};
use crate::config::TrainConfig;
use crate::error::TrainError;

/// Clips of the project's own cameras.
pub struct ReferenceClips {
    /// Sizes of a clip.
    pub shape: ClipShape,
    /// Keys all draws.
    pub seed: u64,
    /// How frames are sampled.
    pub sampling: Sampling,
}

/// Scenario seeds of training clips begin here, so that no shipped or held-out scenario is among them.
pub const FIRST_SCENARIO_SEED: u64 = 1_000_000;

struct Stray {
    from_tick: f64,
    speed_share: f64,
    offset_m: f64,
    heading_rad: f64,
}

impl Stray {
    fn draw(scene: &Scene, frames: usize, draws: &Draws) -> Self {
        let calm = draws.uniform(3) < 0.3;
        let spread = if calm { 0.0 } else { 1.0 };
        let speed_share = if calm { 1.0 } else { draws.range(4, 0.4, 1.3) };
        let last = (f64::from(scene.last_tick().0) - frames as f64 * speed_share.max(1.0)).max(0.0);
        Self {
            from_tick: draws.range(5, 0.0, last).floor(),
            speed_share,
            offset_m: spread * 0.7 * draws.normal(6),
            heading_rad: spread * 0.04 * draws.normal(7),
        }
    }

    /// Returns the ego `k` ticks after the start.
    fn ego(&self, scene: &Scene, k: usize) -> EgoState {
        let at = self.from_tick + k as f64 * self.speed_share;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "ticks are small and not negative")]
        let tick = at.floor() as u32;
        let (a, b) = (scene.logged_ego(Tick(tick)), scene.logged_ego(Tick(tick + 1)));
        let share = at - at.floor();
        let start = scene.logged_ego(Tick(0)).pose.position;
        let heading = a.pose.heading_rad + share * angle::turn(a.pose.heading_rad, b.pose.heading_rad);
        let on_log = PoseSe2 { position: a.pose.position.lerp(b.pose.position, share), heading_rad: heading };
        let travelled = on_log.position.distance(self.pose_at_start(scene, start)).min(30.0);
        let offset = self.offset_m + travelled * self.heading_rad;
        let local = PoseSe2 { position: DVec2::new(0.0, offset), heading_rad: self.heading_rad };
        let speed = a.velocity_mps * self.speed_share;
        EgoState { pose: on_log.compose(&local), velocity_mps: speed, ..*a }
    }

    fn pose_at_start(&self, scene: &Scene, _origin: DVec2) -> DVec2 {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "ticks are small and not negative")]
        let tick = self.from_tick as u32;
        scene.logged_ego(Tick(tick)).pose.position
    }
}

impl ClipSource for ReferenceClips {
    fn clip(&self, index: u64) -> Result<Clip, TrainError> {
        let draws = Draws::new(&ds_space::Digest::of(&self.seed.to_le_bytes()), "clip", &[index]);
        let family = Family::ALL[(index % Family::ALL.len() as u64) as usize];
        // Several clips share a scenario: generating one costs as much as rendering many frames.
        let scene = ds_scenario::generate(family, FIRST_SCENARIO_SEED + self.seed * 4_096 + index / 24);
        let appearance = Appearance::from_seed(draws.u64(0));
        let camera = ReferenceCamera::new(&scene, appearance).with_sampling(self.sampling);
        let map = StaticMap::new(&scene.map);
        let refuse = |reason: String| TrainError::Clip { index, reason };
        let mut layouts = Renderer::new(BackendChoice::Cpu).map_err(|error| refuse(error.to_string()))?;
        let mut model = scene.cameras.first().cloned().ok_or_else(|| refuse("no camera".to_owned()))?;
        model.intrinsics = model.intrinsics.resized(self.shape.width_px, self.shape.height_px);
        let stray = Stray::draw(&scene, self.shape.frames, &draws);
        let mut clip = Clip { frames: Vec::new(), layouts: Vec::new(), prompt: appearance.prompt() };
        for k in 0..self.shape.frames {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "ticks are small")]
            let tick = Tick(stray.from_tick as u32 + k as u32);
            let mut world = scene.logged_world(tick);
            world.ego = stray.ego(&scene, k);
            let world_from_rig = world.ego.pose.world_from_rig(0.0);
            clip.frames.push(camera.render(&world, &model, world_from_rig));
            let layout = LayoutScene { map: &map, world: &world };
            let layout = layouts.render(&layout, &model, world_from_rig);
            clip.layouts.push(layout.map_err(|error| refuse(error.to_string()))?);
        }
        Ok(clip)
    }
}

/// Renders the configured number of clips into the work folder, continuing where an earlier run stopped.
///
/// # Errors
/// If a clip cannot be rendered or written.
pub fn render(config: &TrainConfig, progress: &mut dyn Progress) -> Result<(), TrainError> {
    let model = config.model()?;
    std::fs::create_dir_all(&config.folder).map_err(TrainError::io("work folder", &config.folder))?;
    let shape = batch::clip_shape(config, &model);
    let source = ReferenceClips { shape, seed: config.seed, sampling: Sampling::Smooth };
    batch::clip_file(config, &model).fill(&source, config.data.clips, &mut |index| {
        progress.note(&format!("clip {index} of {}", config.data.clips));
    })
}

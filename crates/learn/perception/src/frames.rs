//! Frames with their truth: generated scenarios in drawn looks, seen from an ego that strays from its log.
//!
//! Each scenario gives a few frames at drawn ticks; the states of its traffic lights are drawn too, so that all are
//! seen alike often. Seeds are counted from a first one, so that no other training or measurement shares a scenario.

use ds_camera::{Appearance, Condition, LabelledCamera, ReferenceCamera, SceneCamera};
use ds_raster::RgbImage;
use ds_scenario::Family;
use ds_space::{DVec2, Draws, PoseSe2, Tick};
use rayon::prelude::*;

use crate::error::PerceptionError;
use crate::label::{Crosswalks, Label};
use crate::lights::{self, SeenLight};

/// Scenario seeds of training frames begin here.
pub const FIRST_TRAINING_SEED: u64 = 3_000_000;
/// Scenario seeds of the networks' own held-out frames begin here.
pub const FIRST_HELD_OUT_SEED: u64 = 2_500_000;

/// How the look of a scenario is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Looks {
    /// Each frame a condition, all alike often.
    Conditions,
    /// Half the scenarios a plain day or night, the others conditions.
    Mixed,
}

impl Looks {
    fn draw(self, index: u64, draws: &Draws) -> Appearance {
        if self == Self::Mixed && index.is_multiple_of(2) {
            return Appearance::from_seed(draws.u64(0));
        }
        let all: Vec<Condition> = Condition::all().collect();
        Appearance::condition(all[draws.below(1, all.len() as u64) as usize], draws.u64(0))
    }
}

/// Which frames are rendered.
#[derive(Debug, Clone, PartialEq)]
pub struct Take {
    /// Families that take turns.
    pub families: Vec<Family>,
    /// The first scenario seed.
    pub first_seed: u64,
    /// Scenarios.
    pub scenarios: u64,
    /// Frames of each.
    pub frames: u64,
    /// How looks are drawn.
    pub looks: Looks,
    /// Width and height, in pixels.
    pub size_px: (u32, u32),
}

/// A frame with its truth.
#[derive(Debug, Clone, PartialEq)]
pub struct Labelled {
    /// What the camera saw.
    pub image: RgbImage,
    /// What each pixel shows, rows top to bottom.
    pub labels: Vec<Label>,
    /// The traffic lights that it shows.
    pub lights: Vec<SeenLight>,
    /// The look that it was rendered in.
    pub look: Appearance,
    /// Index of its scenario.
    pub scenario: u64,
}

/// Renders frames of the reference camera.
///
/// # Errors
/// If a scenario has no camera or its map cannot be rendered.
pub fn render(take: &Take) -> Result<Vec<Labelled>, PerceptionError> {
    let all: Result<Vec<Vec<Labelled>>, _> =
        (0..take.scenarios).into_par_iter().map(|index| scenario(take, index)).collect();
    Ok(all?.into_iter().flatten().collect())
}

fn scenario(take: &Take, index: u64) -> Result<Vec<Labelled>, PerceptionError> {
    let seed = take.first_seed + index;
    let draws = Draws::from_seed(seed, "labelled frames");
    let family = take.families[(index % take.families.len() as u64) as usize];
    let scene = ds_scenario::generate(family, seed);
    let look = take.looks.draw(index / take.families.len() as u64, &draws);
    let camera = ReferenceCamera::new(&scene, look);
    let refuse = |source| PerceptionError::Layout { scenario: scene.name.clone(), source };
    let unseen = |source| PerceptionError::Frame { scenario: scene.name.clone(), source };
    let mut crosswalks = Crosswalks::new(&scene.map).map_err(refuse)?;
    let model = scene.cameras.first().cloned();
    let mut model = model.ok_or_else(|| PerceptionError::NoCamera { scenario: scene.name.clone() })?;
    model.intrinsics = model.intrinsics.resized(take.size_px.0, take.size_px.1);
    let mut frames = Vec::new();
    for k in 0..take.frames {
        let at = |offset: u64| 10 + 8 * k + offset;
        #[expect(clippy::cast_possible_truncation, reason = "below the number of ticks")]
        let tick = Tick(draws.below(at(0), u64::from(scene.last_tick().0) + 1) as u32);
        let mut state = scene.logged_world(tick);
        let beside = DVec2::new(0.0, 0.7 * draws.normal(at(1)));
        let stray = PoseSe2 { position: beside, heading_rad: 0.04 * draws.normal(at(2)) };
        state.ego.pose = state.ego.pose.compose(&stray);
        for (light, index) in state.lights.iter_mut().zip(0..) {
            let states = lights::STATES;
            *light = states[Draws::from_seed(draws.u64(at(3)), "light").below(index, states.len() as u64) as usize];
        }
        let rig = state.ego.pose.world_from_rig(0.0);
        let classes = camera.classes(&state, &model, rig).map_err(unseen)?;
        let labels = crosswalks.label(&classes, &state, &model, rig).map_err(refuse)?;
        let lights = lights::seen(&scene.map.traffic_lights, &state, &labels, &model, rig);
        let image = camera.on_ego(&state, &model).map_err(unseen)?;
        frames.push(Labelled { image, labels, lights, look, scenario: index });
    }
    Ok(frames)
}

//! A case made ready: grey pictures in full size for some frames, small pictures for all, and the rendering of a model.
//!
//! A model is the simulated stream with effects, the nuisance offset of every frame and the age of its content. Ages
//! and geometry act first ("placing"), values afterwards, so that a search over values resamples nothing.

use ds_effect::frame::{Act, FrameEffect};
use ds_effect::picture::Picture;
use ds_effect::{FrameChain, find_frame};

use crate::case::{Frame, FrameCase};
use crate::geometry::{Chosen, moves};
use crate::settings;
use crate::warp::Grid;

/// A case made ready.
pub struct Scene<'a> {
    /// The case.
    pub case: &'a FrameCase,
    /// Its frames to fit.
    pub frames: Vec<&'a Frame>,
    /// Small pictures of every frame: simulated and real.
    pub small: Vec<(Picture, Picture)>,
    /// Full grey pictures of every frame: simulated and real.
    pub grey: Vec<(Picture, Picture)>,
    /// Depth of the small pictures, m.
    pub small_depth_m: Option<Vec<f32>>,
    /// Frames looked at in full size.
    pub full: Vec<usize>,
}

/// Returns the effect of a name that the library must contain.
#[must_use]
pub fn known(id: &str) -> &'static FrameEffect {
    find_frame(id).expect("the library of effects on frames names every effect that this crate names")
}

/// The simulated stream, corrected.
#[derive(Clone)]
pub struct Model {
    /// Effects with their values.
    pub effects: Chosen,
    /// Nuisance offset of every frame, px.
    pub shifts: Vec<[f64; 2]>,
    /// Age of the content of every frame, frames.
    pub ages: Vec<usize>,
    /// First frames whose content is older than the simulated stream; nothing can be said of them.
    pub blind: usize,
    /// Parts of each frame that objects spoil, px; nothing else can be said of them.
    pub lost: Vec<Vec<[f64; 4]>>,
    /// ln gain of light over each frame, where brightness flickers: knots of a smooth field.
    pub flicker: Option<Vec<crate::flicker::Field>>,
    /// What fixed places of the picture lose, where the lens is dirty.
    pub dirt: Option<crate::dirt::Map>,
}

impl Model {
    /// Returns the model without effects on detail finer than small pictures show, if it has any.
    #[must_use]
    pub fn coarsened(&self) -> Option<Self> {
        let mut without = self.clone();
        without.effects.retain(|(e, _)| !DETAIL.contains(&e.id));
        (without.effects.len() < self.effects.len()).then_some(without)
    }
}

/// Frames of a model in place, before their values are edited.
pub struct Placed {
    /// Small pictures of all frames.
    pub small: Vec<Picture>,
    /// Full grey pictures of the frames in `Scene::full`.
    pub full: Vec<Picture>,
}

impl<'a> Scene<'a> {
    /// Makes the frames of a case that are to be fitted ready.
    #[must_use]
    pub fn new(case: &'a FrameCase) -> Self {
        Self::of(case, case.fit.iter().collect())
    }

    /// Makes some frames of a case ready.
    #[must_use]
    pub fn of(case: &'a FrameCase, frames: Vec<&'a Frame>) -> Self {
        let small = frames.iter().map(|f| (f.sim.shrunk(settings::SMALL), f.real.shrunk(settings::SMALL))).collect();
        let grey = frames.iter().map(|f| (f.sim.grey(), f.real.grey())).collect();
        let count = settings::FULL_FRAMES.min(frames.len());
        let full = (0..count).map(|k| (2 * k + 1) * frames.len() / (2 * count)).collect();
        Self { case, small_depth_m: small_depth(case), frames, small, grey, full }
    }

    /// Tells whether the effect can show with what this case tells.
    #[must_use]
    pub fn can_show(&self, effect: &FrameEffect) -> bool {
        use ds_effect::frame::Needs;
        effect.needs.iter().all(|need| match need {
            Needs::Picture => true,
            Needs::Sequence => self.frames.len() > 3,
            Needs::Colour => self.small[0].0.channels == 3,
            Needs::Depth => self.case.depth_m.is_some(),
            Needs::Boxes => self.frames.iter().any(|f| !f.boxes.is_empty()),
            Needs::Light => self.frames.iter().any(|f| (f.light / self.frames[0].light).ln().abs() > 0.05),
            Needs::Motion => self.frames.iter().any(|f| f.speed_mps.is_some_and(|v| v.abs() > 0.5)),
        })
    }

    /// Moves the simulated frames of a model into place.
    #[must_use]
    pub fn placed(&self, model: &Model) -> Placed {
        let chain = FrameChain::new(&model.effects.iter().filter(|(e, _)| moves(e)).cloned().collect::<Vec<_>>());
        let small = (0..self.frames.len()).map(|k| self.placed_small(model, &chain, k)).collect();
        let full = self.full.iter().map(|k| self.placed_full(model, &chain, *k)).collect();
        Placed { small, full }
    }

    /// Moves one frame in full size, then makes it small: a small picture moved by a fraction would alias.
    fn placed_small(&self, model: &Model, chain: &FrameChain, k: usize) -> Picture {
        let context = self.case.context(self.frames[k], 1, self.case.depth_m.as_deref());
        let source = &self.frames[k.saturating_sub(model.ages[k])].sim;
        Grid::new(chain, &context, model.shifts[k]).apply(source).shrunk(settings::SMALL)
    }

    /// Moves one full grey frame into place.
    #[must_use]
    pub fn placed_full(&self, model: &Model, chain: &FrameChain, k: usize) -> Picture {
        let context = self.case.context(self.frames[k], 1, self.case.depth_m.as_deref());
        Grid::new(chain, &context, model.shifts[k]).apply(&self.grey[k.saturating_sub(model.ages[k])].0)
    }

    /// Edits the values of placed small pictures; all frames, in order.
    #[must_use]
    pub fn small_of(&self, model: &Model, placed: &[Picture]) -> Vec<Picture> {
        let all: Vec<usize> = (0..placed.len()).collect();
        self.some_small_of(model, placed, &all)
    }

    /// Edits the values of some placed small pictures; frames in between are only remembered.
    #[must_use]
    pub fn some_small_of(&self, model: &Model, placed: &[Picture], frames: &[usize]) -> Vec<Picture> {
        let mut chain = FrameChain::new(&small_values_of(model));
        let mut out = Vec::with_capacity(frames.len());
        for (k, picture) in placed.iter().enumerate() {
            let context = self.case.context(self.frames[k], settings::SMALL, self.small_depth_m.as_deref());
            if !frames.contains(&k) {
                chain.pass(&context);
                continue;
            }
            let mut edited = chain.edited(picture.clone(), &context);
            model.finish(k, &mut edited);
            out.push(edited);
        }
        out
    }

    /// Edits the values of placed full pictures.
    #[must_use]
    pub fn full_of(&self, model: &Model, placed: &[Picture]) -> Vec<Picture> {
        let mut chain = FrameChain::new(&values_of(model));
        let mut out = Vec::with_capacity(placed.len());
        for (k, frame) in self.frames.iter().enumerate() {
            let context = self.case.context(frame, 1, self.case.depth_m.as_deref());
            if let Some(at) = self.full.iter().position(|f| *f == k) {
                let mut edited = chain.edited(placed[at].clone(), &context);
                model.finish(k, &mut edited);
                out.push(edited);
            } else {
                // what an effect remembers goes on through frames that are not looked at
                chain.pass(&context);
            }
        }
        out
    }
}

impl Model {
    /// The simulated stream as it is.
    #[must_use]
    pub fn nominal(frames: usize) -> Self {
        Self {
            effects: Vec::new(),
            shifts: vec![[0.0; 2]; frames],
            ages: vec![0; frames],
            blind: 0,
            lost: vec![Vec::new(); frames],
            flicker: None,
            dirt: None,
        }
    }

    /// Returns the values of an effect.
    #[must_use]
    pub fn values(&self, id: &str) -> Option<&[f64]> {
        self.effects.iter().find(|(e, _)| e.id == id).map(|(_, v)| v.as_slice())
    }

    /// Adds or replaces an effect.
    pub fn set(&mut self, effect: &'static FrameEffect, values: Vec<f64>) {
        match self.effects.iter_mut().find(|(e, _)| e.id == effect.id) {
            Some((_, v)) => *v = values,
            None => self.effects.push((effect, values)),
        }
    }

    /// Adds what was measured frame by frame or place by place, rather than by a few values.
    fn finish(&self, k: usize, picture: &mut Picture) {
        if let Some(field) = self.flicker.as_ref().map(|f| &f[k]) {
            field.apply(picture);
        }
        if let Some(dirt) = &self.dirt {
            dirt.apply(picture);
        }
    }
}

/// Effects that edit values and whose outcome is no chance.
fn values_of(model: &Model) -> Chosen {
    let by_chance = |id: &str| CHANCE.contains(&id);
    model.effects.iter().filter(|(e, _)| matches!(e.act, Act::Edit(_)) && !by_chance(e.id)).cloned().collect()
}

/// The same for small pictures, which cannot show what acts on single pixels: see [`Model::coarsened`].
fn small_values_of(model: &Model) -> Chosen {
    let mut values = values_of(model);
    values.retain(|(e, _)| !DETAIL.contains(&e.id));
    values
}

/// Effects that act on single pixels of the full size.
pub const DETAIL: [&str; 3] = ["defocus", "jpeg_loss", "texture_washing"];

/// Effects whose outcome in a given frame cannot be foretold from their values.
pub const CHANCE: [&str; 8] = [
    "sensor_noise",
    "rain_streaks",
    "lens_dirt",
    "temporal_flicker",
    "object_dropout",
    "object_hallucination",
    "identity_switch",
    "layout_misalignment",
];

fn small_depth(case: &FrameCase) -> Option<Vec<f32>> {
    let depth = case.depth_m.as_ref()?;
    let picture = Picture { width: case.size[0], height: case.size[1], channels: 1, data: depth.clone() };
    Some(picture.shrunk(settings::SMALL).data)
}

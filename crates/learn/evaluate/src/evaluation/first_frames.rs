//! First frames from layout and prompt alone: whether they show what ordinary words say.

use std::collections::BTreeMap;

use ds_camera::{Appearance, CameraWorld, Condition};
use ds_perception::Label;
use ds_perception::look::LookReader;
use ds_raster::RgbImage;
use ds_space::Draws;
use ds_stats::mean;
use ds_train::colour::{Colour, luma};
use ds_train::first_frame::{FirstFrames, Request};
use ds_video::ModelConfig;
use ds_world::Wording;

use super::Evaluation;
use crate::config::{FirstFramesConfig, condition};
use crate::drive::{Drive, Route};
use crate::error::EvaluationError;
use crate::outcome::{FIRST_FRAMES_SHEET, FirstFramesOutcome, LookFigures, WordedOutcome};

/// What is measured of a frame: whether its look is named right, luma, luma of the road, contrast, detail.
type Seen = [f64; 5];

/// Scenarios of which the page shows frames.
const SHEET_SCENARIOS: usize = 3;

/// The frame that words make and the world's own in the condition that they are to name.
struct Pair {
    frames: [RgbImage; 2],
    seen: [Seen; 2],
}

/// What makes pairs and looks at them.
struct Studio<'a> {
    config: &'a FirstFramesConfig,
    maker: FirstFrames,
    world: &'a dyn CameraWorld,
    looks: &'a LookReader,
    size_px: (u32, u32),
}

impl Studio<'_> {
    /// Makes the pair of a text; `palette` draws the colours of the scene, `seed` the noise.
    fn pair(
        &self,
        route: &Route,
        wanted: Condition,
        text: &str,
        [palette, seed]: [u64; 2],
    ) -> Result<Pair, EvaluationError> {
        let drive = |condition| {
            let look = Appearance::condition(condition, palette);
            Drive::new(self.world, &Route { look, ..route.clone() }, self.size_px)
        };
        let mut told = drive(Wording::read(text).condition().unwrap_or(Condition::DAY))?;
        let layout = told.layout(0)?;
        let request = Request {
            layout: &layout,
            prompt: &told.prompt,
            key: Draws::key(&told.draw_key, "first frame", seed),
            steps: self.config.steps,
            guidance: self.config.guidance,
        };
        let made = self.maker.make(&request).map_err(|source| EvaluationError::FirstFrames { source })?;
        let frames = [made, drive(wanted)?.frame(0)?];
        let road: Vec<bool> = told.labels(0)?.iter().map(|label| *label == Label::Road).collect();
        let seen = frames.each_ref().map(|frame| seen(frame, &road, self.looks.read(frame).shows(wanted)));
        Ok(Pair { frames, seen })
    }
}

impl Evaluation<'_> {
    pub(super) fn first_frames(&mut self, config: &FirstFramesConfig) -> Result<FirstFramesOutcome, EvaluationError> {
        let preset = ModelConfig::load(&self.config.path(&config.model))
            .map_err(|error| EvaluationError::config("first_frames.model", error.to_string()))?;
        let maker = FirstFrames::load(&preset, &self.config.path(&config.weights))
            .map_err(|source| EvaluationError::FirstFrames { source })?;
        let (world, size_px) = (self.columns[0].world, (preset.video.width_px, preset.video.height_px));
        let studio = Studio { config, maker, world, looks: &self.eyes.look, size_px };
        let routes = self.columns[0].routes(config.scenarios as usize, &[0], 1.0).concat();
        self.progress.ahead(routes.len() as u64 * config.wordings.len() as u64);
        let (mut days, mut made) = (Vec::new(), BTreeMap::<&String, Vec<Vec<[Seen; 2]>>>::new());
        let mut sheet = BTreeMap::<&String, Vec<RgbImage>>::new();
        for (palette, route) in (7_000..).zip(&routes) {
            days.push(studio.pair(route, Condition::DAY, "", [palette, 0])?.seen);
            for (name, texts) in &config.wordings {
                let wanted = condition("first_frames.wordings", name)?;
                let pairs = (0..).zip(texts).map(|(seed, text)| studio.pair(route, wanted, text, [palette, seed]));
                let mut pairs = pairs.collect::<Result<Vec<Pair>, _>>()?;
                made.entry(name).or_default().push(pairs.iter().map(|pair| pair.seen).collect());
                if days.len() <= SHEET_SCENARIOS {
                    sheet.entry(name).or_default().extend(pairs.swap_remove(0).frames);
                }
                self.progress.done(&format!("first frames of {name}, {}", route.scene.name), false);
            }
        }
        let rows: Vec<Vec<RgbImage>> = sheet.into_values().collect();
        ds_train::sheet::write(&self.config.out.join(FIRST_FRAMES_SHEET), &rows)
            .map_err(|source| EvaluationError::Stills { source })?;
        let recognised = self.resamples.estimate(routes.len(), |picks| {
            let of = |pick: usize| made.values().flat_map(move |scenarios| &scenarios[pick]);
            mean(picks.iter().flat_map(|pick| of(*pick)).map(|[words, _]| words[0]))
        });
        let summed = |(name, frames): (&&String, &Vec<Vec<[Seen; 2]>>)| {
            let [words, own] = [0, 1].map(|whose| self.shown(frames, &days, whose));
            ((*name).clone(), WordedOutcome { words, own })
        };
        Ok(FirstFramesOutcome { recognised, conditions: made.iter().map(summed).collect() })
    }

    /// Sums up the frames of a condition, by scenario, from words (0) or the world's own (1).
    fn shown(&self, frames: &[Vec<[Seen; 2]>], days: &[[Seen; 2]], whose: usize) -> LookFigures {
        let over = |which: usize, ratio: bool| {
            self.resamples.estimate(frames.len(), |picks| {
                let one = |pick: &usize| {
                    let day = if ratio { days[*pick][whose][which].max(1e-6) } else { 1.0 };
                    frames[*pick].iter().map(move |seen| seen[whose][which] / day)
                };
                mean(picks.iter().flat_map(one))
            })
        };
        LookFigures {
            recognised: over(0, false),
            luma: over(1, true),
            ground: over(2, true),
            contrast: over(3, true),
            detail: over(4, true),
        }
    }
}

fn seen(frame: &RgbImage, road: &[bool], right: bool) -> Seen {
    let colour = Colour::of(frame);
    let road = luma(frame).into_iter().zip(road).filter(|(_, road)| **road).map(|(luma, _)| luma);
    [f64::from(u8::from(right)), colour.luma, mean(road).unwrap_or(0.0), colour.contrast, colour.detail]
}

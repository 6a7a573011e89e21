//! First frames from layout and prompt alone: whether they show what ordinary words say.

use std::collections::BTreeMap;

use ds_camera::{Appearance, Condition};
use ds_perception::Label;
use ds_perception::look::Look;
use ds_raster::RgbImage;
use ds_space::Draws;
use ds_stats::mean;
use ds_train::colour::{Colour, luma};
use ds_train::first_frame::{FirstFrames, Request};
use ds_video::ModelConfig;
use ds_world::Wording;

use super::Evaluation;
use crate::config::FirstFramesConfig;
use crate::drive::{Drive, Route};
use crate::error::AppraisalError;
use crate::outcome::{FIRST_FRAMES_SHEET, FirstFramesOutcome, Shown, WordedOutcome};

/// What is measured of a frame: whether its look is named right, luma, luma of the road, contrast, detail.
type Seen = [f64; 5];

/// Scenarios of which the page shows frames.
const SHEET_SCENARIOS: usize = 3;

impl Evaluation<'_> {
    pub(super) fn first_frames(&mut self, config: &FirstFramesConfig) -> Result<FirstFramesOutcome, AppraisalError> {
        let wrap = |source| AppraisalError::FirstFrames { source };
        let preset = ModelConfig::load(&self.config.path(&config.model))
            .map_err(|error| AppraisalError::config("first_frames.model", error.to_string()))?;
        let maker = FirstFrames::load(&preset, &self.config.path(&config.weights)).map_err(wrap)?;
        let size_px = (preset.video.width_px, preset.video.height_px);
        let routes: Vec<Route> =
            self.columns[0].routes(config.scenarios as usize, &[0], 1.0).into_iter().flatten().collect();
        let world = self.columns[0].world;
        self.progress.ahead(routes.len() as u64 * (1 + config.wordings.len() as u64));
        let (mut days, mut made) = (Vec::new(), BTreeMap::<&String, Vec<[Vec<Seen>; 2]>>::new());
        let mut sheet = BTreeMap::<&String, Vec<RgbImage>>::new();
        for (at, route) in routes.iter().enumerate() {
            let day = std::iter::once((None, "ordinary daylight", vec![""]));
            let worded = config
                .wordings
                .iter()
                .map(|(name, texts)| (Some(name), name.as_str(), texts.iter().map(String::as_str).collect()));
            for (name, what, texts) in day.chain(worded) {
                let told = |text: &str| Wording::read(text).condition();
                let wanted = name.map_or(Ok(Condition::DAY), |name| condition(name))?;
                let (mut words, mut own) = (Vec::new(), Vec::new());
                for (seed, text) in (0..).zip(texts) {
                    // The frame follows the words alone, the world's own the condition that they are to name.
                    let heard = told(text).unwrap_or(Condition::DAY);
                    let look = |condition| Appearance::condition(condition, 7_000 + at as u64);
                    let mut drive = Drive::new(world, &Route { look: look(heard), ..route.clone() }, size_px)?;
                    let layout = drive.layout(0)?.image;
                    let request = Request {
                        layout: &layout,
                        prompt: &drive.prompt,
                        key: Draws::key(&drive.draw_key, "first frame", seed),
                        steps: config.steps,
                        guidance: config.guidance,
                    };
                    let frame = maker.make(&request).map_err(wrap)?;
                    let ground: Vec<bool> = drive.labels(0)?.iter().map(|label| *label == Label::Road).collect();
                    words.push(seen(&frame, &ground, wanted, &self.eyes.look.read(&frame)));
                    let truth = Drive::new(world, &Route { look: look(wanted), ..route.clone() }, size_px)?;
                    let rendered = truth.frame(0)?;
                    own.push(seen(&rendered, &ground, wanted, &self.eyes.look.read(&rendered)));
                    if let Some(name) = name.filter(|_| seed == 0 && at < SHEET_SCENARIOS) {
                        sheet.entry(name).or_default().extend([frame, rendered]);
                    }
                }
                self.progress.done(&format!("first frames of {what}, {}", route.scene.name), false);
                match name {
                    Some(name) => made.entry(name).or_default().push([words, own]),
                    None => days.push([words[0], own[0]]),
                }
            }
        }
        let rows: Vec<Vec<RgbImage>> = sheet.into_values().collect();
        ds_train::sheet::write(&self.config.out.join(FIRST_FRAMES_SHEET), &rows)
            .map_err(|source| AppraisalError::Stills { source })?;
        let summed = |frames: &Vec<[Vec<Seen>; 2]>| {
            let [words, own] = [0, 1].map(|whose| self.shown(frames, &days, whose));
            WordedOutcome { words, own }
        };
        let all: Vec<[Vec<Seen>; 2]> = made.values().flatten().cloned().collect();
        let scenarios = routes.len();
        let recognised = self.resamples.estimate(scenarios, |picks| {
            let of = |pick: &usize| all.iter().skip(*pick).step_by(scenarios).flat_map(|frames| &frames[0]);
            mean(picks.iter().flat_map(of).map(|seen| seen[0]))
        });
        let conditions = made.iter().map(|(name, frames)| ((*name).clone(), summed(frames))).collect();
        Ok(FirstFramesOutcome { recognised, conditions })
    }

    /// Sums up the frames of a condition, by scenario, from words (0) or the world's own (1).
    fn shown(&self, frames: &[[Vec<Seen>; 2]], days: &[[Seen; 2]], whose: usize) -> Shown {
        let over = |which: usize, ratio: bool| {
            self.resamples.estimate(frames.len(), |picks| {
                let one = |pick: &usize| {
                    let day = if ratio { days[*pick][whose][which].max(1e-6) } else { 1.0 };
                    frames[*pick][whose].iter().map(move |seen| seen[which] / day)
                };
                mean(picks.iter().flat_map(one))
            })
        };
        Shown {
            recognised: over(0, false),
            luma: over(1, true),
            ground: over(2, true),
            contrast: over(3, true),
            detail: over(4, true),
        }
    }
}

/// Reads the name of a condition.
fn condition(name: &str) -> Result<Condition, AppraisalError> {
    name.parse().map_err(|error| AppraisalError::config("first_frames.wordings", format!("{error}")))
}

fn seen(frame: &RgbImage, ground: &[bool], wanted: Condition, look: &Look) -> Seen {
    let colour = Colour::of(frame);
    let road = luma(frame).into_iter().zip(ground).filter(|(_, ground)| **ground).map(|(luma, _)| luma);
    [f64::from(u8::from(look.shows(wanted))), colour.luma, mean(road).unwrap_or(0.0), colour.contrast, colour.detail]
}

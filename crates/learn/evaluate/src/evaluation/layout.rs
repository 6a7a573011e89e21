//! Layout, fidelity, colour and seam figures of short clips, by column and arm, with comparisons over the same scenarios.

use std::collections::BTreeMap;

use ds_fidelity::{Features, Principal};
use ds_perception::lights::two_pixel_distance_m;
use ds_perception::overlap::Target;

use super::Evaluation;
use crate::config::LayoutConfig;
use crate::error::EvaluationError;
use crate::estimate::{Estimate, Resamples};
use crate::outcome::{ArmLayout, ColumnLayout, LayoutOutcome, LightBin};
use crate::summary::Rollouts;
use crate::watch::{FrameSelection, Viewing};
use ds_train::colour::Colour;

/// Upper ends of the distances of which lights are reported apart, in metres.
const DISTANCES_M: [f64; 5] = [15.0, 30.0, 45.0, 65.0, 90.0];
/// Directions that features are reduced to.
const DIRECTIONS: usize = 16;
/// Share of each covariance's off-diagonal that is removed.
const SHRINKAGE: f64 = 0.1;

/// An arm's records and its reduced features.
struct Seen {
    rollouts: Rollouts,
    features: Features,
}

impl Evaluation<'_> {
    pub(super) fn layout(&mut self, config: &LayoutConfig) -> Result<LayoutOutcome, EvaluationError> {
        let arms = Self::named([&config.iou, &config.feature_distance]);
        let size_px = self.size_px(&arms)?;
        let looked: Vec<u32> = (config.first..=config.frames).step_by(config.every as usize).collect();
        let mut plan = FrameSelection { looked, truth: true };
        // A rollout is made to the end of the clip, whatever is looked at last.
        if plan.last() < config.frames {
            plan.looked.push(config.frames);
        }
        let mut outcome = LayoutOutcome {
            iou: config.iou.clone(),
            feature_distance: config.feature_distance.clone(),
            clips: (config.starts.clone(), config.frames, config.first, config.every),
            ..LayoutOutcome::default()
        };
        if let Some(model) = self.columns.first().and_then(|column| column.scenes.first()?.0.cameras.first()) {
            let mut model = model.clone();
            model.intrinsics = model.intrinsics.resized(size_px.0, size_px.1);
            outcome.two_pixels_m = two_pixel_distance_m(&model);
        }
        for column in 0..self.columns.len() {
            let routes = self.columns[column].routes(self.columns[column].scenarios, &config.starts, 1.0);
            let reference = self.rollouts(None, column, &routes, Viewing { plan: &plan, size_px })?;
            let span = (0, config.frames);
            let principal = Principal::fit(&reference.features(span).all(), DIRECTIONS)?;
            let own = Seen { features: reference.features(span).reduced(&principal)?, rollouts: reference };
            let mut seen = BTreeMap::new();
            for arm in &arms {
                let rollouts = self.rollouts(Some(arm), column, &routes, Viewing { plan: &plan, size_px })?;
                let features = rollouts.features(span).reduced(&principal)?;
                seen.insert(arm.clone(), Seen { rollouts, features });
            }
            let name = self.columns[column].name.clone();
            let figures = ColumnLayout {
                reference: figures(&own, None, self.resamples),
                arms: seen.iter().map(|(arm, seen)| (arm.clone(), figures(seen, Some(&own), self.resamples))).collect(),
                comparisons: comparisons(config, &own, &seen, self.resamples),
            };
            outcome.columns.insert(name, figures);
        }
        Ok(outcome)
    }
}

fn figures(seen: &Seen, own: Option<&Seen>, resamples: Resamples) -> ArmLayout {
    let rollouts = &seen.rollouts;
    let count = rollouts.scenarios();
    let iou =
        |target: Target| (target.name().to_owned(), resamples.estimate(count, |picks| rollouts.iou(picks, target)));
    let mut from = 0.0;
    let bin = |to_m: f64| {
        let (range, all) = ((from, to_m), (0..count).collect::<Vec<_>>());
        from = to_m;
        let share = |picks: &[usize]| {
            let (right, seen) = rollouts.lights(picks, range);
            (seen > 0).then(|| right as f64 / seen as f64)
        };
        let accuracy = resamples.estimate(count, share);
        LightBin { from_m: range.0, to_m, accuracy, seen: rollouts.lights(&all, range).1 }
    };
    let lights = DISTANCES_M.map(bin).to_vec();
    let colour = |(index, name): (usize, &str)| {
        let value = resamples.estimate(count, |picks| rollouts.mean(picks, |g| Some(g.colour.values()[index])));
        (name.to_owned(), value)
    };
    let all: Vec<usize> = (0..count).collect();
    ArmLayout {
        iou: Target::ALL.into_iter().map(iou).collect(),
        error: resamples.estimate(count, |picks| Some(1.0 - rollouts.following(picks)?)),
        lights,
        psnr_db: resamples.estimate(count, |picks| rollouts.mean(picks, |glance| glance.psnr_db)),
        distance: resamples.estimate(count, |picks| rollouts.mean(picks, |glance| glance.distance)),
        frechet: own.and_then(|own| frechet(seen, own, resamples)),
        colour: Colour::NAMES.into_iter().enumerate().map(colour).collect(),
        seam: resamples.estimate(count, |picks| rollouts.seam(picks)),
        frames: rollouts.glances(&all).count() as u64,
    }
}

fn frechet(seen: &Seen, own: &Seen, resamples: Resamples) -> Option<Estimate> {
    resamples.estimate(seen.rollouts.scenarios(), |picks| seen.features.distance(&own.features, picks, SHRINKAGE))
}

/// Compares arms over the same scenarios, as the bars ask for it.
fn comparisons(
    config: &LayoutConfig,
    own: &Seen,
    seen: &BTreeMap<String, Seen>,
    resamples: Resamples,
) -> BTreeMap<String, Option<Estimate>> {
    let arm = |key: &str| config.iou.get(key).and_then(|arm| seen.get(arm));
    let guidance = |key: &str| config.feature_distance.get(key).and_then(|arm| seen.get(arm));
    let count = own.rollouts.scenarios();
    let mut all = BTreeMap::new();
    let mut ratio = |name: &str, pair: Option<(&Seen, &Seen)>, figure: fn(&Seen, &[usize]) -> Option<f64>| {
        let estimate = pair.and_then(|(top, bottom)| {
            resamples.estimate(count, |picks| Some(figure(top, picks)? / figure(bottom, picks)?))
        });
        all.insert(name.to_owned(), estimate);
    };
    let following: fn(&Seen, &[usize]) -> Option<f64> = |seen, picks| seen.rollouts.following(picks);
    let error: fn(&Seen, &[usize]) -> Option<f64> = |seen, picks| Some(1.0 - seen.rollouts.following(picks)?);
    ratio("teacher_iou_over_no_layout", arm("teacher").zip(arm("no_layout")), following);
    ratio("teacher_iou_over_reference", arm("teacher").map(|teacher| (teacher, own)), following);
    ratio("student_iou_over_no_layout", arm("student").zip(arm("no_layout")), following);
    ratio("student_iou_over_reference", arm("student").map(|student| (student, own)), following);
    ratio("student_error_over_teacher", arm("student").zip(arm("teacher")), error);
    for other in ["standard_cfg", "no_guidance"] {
        let pair = guidance("layout_guidance").zip(guidance(other));
        let estimate = pair.and_then(|(ours, other)| {
            resamples.estimate(count, |picks| {
                let distance = |seen: &Seen| seen.features.distance(&own.features, picks, SHRINKAGE);
                Some(1.0 - distance(ours)? / distance(other)?)
            })
        });
        all.insert(format!("distance_reduction_against_{other}"), estimate);
    }
    all
}

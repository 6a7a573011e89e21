//! Whether frames are as sharp as the world's own: detail, blocks and seams along whole drives.

use std::collections::BTreeMap;

use super::Evaluation;
use crate::config::SharpnessConfig;
use crate::error::EvaluationError;
use crate::estimate::Resamples;
use crate::outcome::{Sharpness, SharpnessOutcome};
use crate::summary::Rollouts;
use crate::watch::{FrameSelection, Viewing};

impl Evaluation<'_> {
    pub(super) fn sharpness(&mut self, config: &SharpnessConfig) -> Result<SharpnessOutcome, EvaluationError> {
        let arms = Self::named([&config.arms]);
        let size_px = self.size_px(&arms)?;
        let looked = (config.first..=config.last).step_by(config.every as usize).collect();
        let plan = FrameSelection { looked, truth: true };
        let frames = (config.first, config.last, config.every);
        let mut outcome = SharpnessOutcome { arms: config.arms.clone(), frames, ..SharpnessOutcome::default() };
        for column in 0..self.columns.len() {
            let routes = self.columns[column].routes(config.rollouts as usize, &[0], 1.0);
            let own = self.rollouts(None, column, &routes, Viewing { plan: &plan, size_px })?;
            let mut found = BTreeMap::new();
            let mut beside = BTreeMap::new();
            for arm in &arms {
                let made = self.rollouts(Some(arm), column, &routes, Viewing { plan: &plan, size_px })?;
                found.insert(arm.clone(), figures(&made, &own, self.resamples));
                beside.insert(arm, made);
            }
            let name = &self.columns[column].name;
            let of = |key: &str| config.arms.get(key).and_then(|arm| beside.get(arm));
            if let Some((told, bare)) = of("student").zip(of("bare")) {
                let gain = |picks: &[usize]| Some(1.0 - off_road(told, picks)? / off_road(bare, picks)?);
                let gain = self.resamples.estimate(told.scenarios(), gain);
                outcome.structures_gain.extend(gain.map(|gain| (name.clone(), gain)));
            }
            outcome.columns.insert(name.clone(), found);
        }
        Ok(outcome)
    }
}

/// The distance beside the road around frame 50.
fn off_road(made: &Rollouts, picks: &[usize]) -> Option<f64> {
    made.mean(picks, |glance| glance.off_road.filter(|_| glance.frame.abs_diff(50) <= 5))
}

fn figures(made: &Rollouts, own: &Rollouts, resamples: Resamples) -> Sharpness {
    let count = made.scenarios();
    let detail = |of: &Rollouts, picks: &[usize]| of.mean(picks, |glance| Some(glance.colour.detail));
    let borders = |of: &Rollouts, picks: &[usize]| {
        Some(of.mean(picks, |glance| Some(glance.steps.across))? / of.mean(picks, |glance| Some(glance.steps.inside))?)
    };
    Sharpness {
        psnr_db: resamples.estimate(count, |picks| made.mean(picks, |glance| glance.psnr_db)),
        laplacian_ratio: resamples.estimate(count, |picks| Some(detail(made, picks)? / detail(own, picks)?)),
        border_ratio: resamples.estimate(count, |picks| borders(made, picks)),
        reference_border_ratio: resamples.estimate(count, |picks| borders(own, picks)),
        seam: resamples.estimate(count, |picks| made.seam(picks)),
        off_road_distance: resamples.estimate(count, |picks| off_road(made, picks)),
    }
}

//! Drift: how the distance of generated from true frames grows along a rollout, and the slopes of a long run.
//!
//! Distance at a mark k: Fréchet over features of frames k − window + 1 to k of all rollouts against the world's own
//! frames of the same moments, reduced to the directions of the latter.

use std::collections::BTreeMap;

use ds_fidelity::{Features, Principal};

use super::Evaluation;
use crate::config::{DriftConfig, LongConfig};
use crate::error::EvaluationError;
use crate::estimate::{Estimate, Resamples, mean};
use crate::outcome::{ArmDrift, ColumnDrift, DriftOutcome, LongOutcome};
use crate::record::Glance;
use crate::summary::{Rollouts, slope};
use crate::watch::{FrameSelection, Viewing};
use ds_train::colour::Colour;

/// The mark from which a rise is counted.
const EARLY_MARK: u32 = 50;
/// Frames between looks of the long run.
const LONG_EVERY: usize = 20;

/// Reduced features of an arm, or of the world's own frames, at every mark.
type AtMarks = Vec<Features>;

impl Evaluation<'_> {
    pub(super) fn drift(&mut self, config: &DriftConfig) -> Result<DriftOutcome, EvaluationError> {
        let arms = Self::named([&config.arms]);
        let size_px = self.size_px(&arms)?;
        let mut looked: Vec<u32> = config.marks.iter().flat_map(|mark| mark + 1 - config.window..=*mark).collect();
        looked.sort_unstable();
        looked.dedup();
        let plan = FrameSelection { looked, truth: false };
        let mut columns = BTreeMap::new();
        for column in 0..self.columns.len() {
            let routes = self.columns[column].routes(config.rollouts as usize, &[0], config.pace);
            let own = self.rollouts(None, column, &routes, Viewing { plan: &plan, size_px })?;
            let principal = Principal::fit(&own.features((0, plan.last())).all(), config.directions)?;
            let own_features = at_marks(&own, config, &principal)?;
            let (mut found, mut features) = (ColumnDrift::default(), BTreeMap::new());
            for arm in &arms {
                let made = self.rollouts(Some(arm), column, &routes, Viewing { plan: &plan, size_px })?;
                let made_features = at_marks(&made, config, &principal)?;
                let mut figures = curve(config, &made_features, &own_features, self.resamples);
                figures.colour = colours(config, &made, &own, self.resamples);
                if let Some(long) = &config.long {
                    figures.long = Some(self.long(arm, column, config, long, size_px)?);
                }
                found.arms.insert(arm.clone(), figures);
                features.insert(arm.clone(), made_features);
            }
            let of = |key: &str| config.arms.get(key).and_then(|arm| features.get(arm));
            if let Some((early, clean)) = of("early_timestep").zip(of("clean")) {
                let rise = |of: &AtMarks, picks: &[usize]| rise(config, of, &own_features, picks);
                let count = own.scenarios();
                found.difference =
                    self.resamples.estimate(count, |picks| Some(rise(clean, picks)? - rise(early, picks)?));
                found.reduction =
                    self.resamples.estimate(count, |picks| Some(1.0 - rise(early, picks)? / rise(clean, picks)?));
            }
            columns.insert(self.columns[column].name.clone(), found);
        }
        Ok(DriftOutcome { arms: config.arms.clone(), window: config.window, pace: config.pace, columns })
    }

    fn long(
        &mut self,
        arm: &str,
        column: usize,
        config: &DriftConfig,
        long: &LongConfig,
        size_px: (u32, u32),
    ) -> Result<LongOutcome, EvaluationError> {
        let plan = FrameSelection { looked: (long.from..=long.frames).step_by(LONG_EVERY).collect(), truth: false };
        let routes = self.columns[column].routes(long.rollouts as usize, &[0], config.pace);
        let own = self.rollouts(None, column, &routes, Viewing { plan: &plan, size_px })?;
        let made = self.rollouts(Some(arm), column, &routes, Viewing { plan: &plan, size_px })?;
        let count = own.scenarios();
        let pairs = |picks: &[usize], figure: &dyn Fn(&Glance, &Glance) -> f64| {
            let along = |(made, own): (&Glance, &Glance)| (f64::from(made.frame) / 100.0, figure(made, own));
            slope(&made.glances(picks).zip(own.glances(picks)).map(along).collect::<Vec<_>>())
        };
        let colour = |(index, name): (usize, &str)| {
            let apart = |made: &Glance, own: &Glance| made.colour.values()[index] - own.colour.values()[index];
            (name.to_owned(), self.resamples.estimate(count, |picks| pairs(picks, &apart)))
        };
        let apart = |made: &Glance, own: &Glance| {
            let squares = made.features.iter().zip(&own.features).map(|(a, b)| f64::from(a - b).powi(2));
            squares.sum::<f64>().sqrt()
        };
        let last_looks = |rollouts: &Rollouts, picks: &[usize]| {
            let late = |glance: &Glance| (glance.frame + 100 > long.frames).then_some(glance.colour.contrast);
            rollouts.mean(picks, late)
        };
        Ok(LongOutcome {
            frames: (long.frames, long.from),
            colour_slopes: Colour::NAMES.into_iter().enumerate().map(colour).collect(),
            feature_slope: self.resamples.estimate(count, |picks| pairs(picks, &apart)),
            contrast_kept: self
                .resamples
                .estimate(count, |picks| Some(last_looks(&made, picks)? / last_looks(&own, picks)?)),
        })
    }
}

fn at_marks(rollouts: &Rollouts, config: &DriftConfig, principal: &Principal) -> Result<AtMarks, EvaluationError> {
    let reduced = |mark: &u32| Ok(rollouts.features((mark + 1 - config.window, *mark)).reduced(principal)?);
    config.marks.iter().map(reduced).collect()
}

fn curve(config: &DriftConfig, made: &AtMarks, own: &AtMarks, resamples: Resamples) -> ArmDrift {
    let count = own.first().map_or(0, |features| features.0.len());
    let at = |index: usize| -> Option<Estimate> {
        resamples.estimate(count, |picks| made[index].distance(&own[index], picks, config.shrinkage))
    };
    ArmDrift {
        curve: config.marks.iter().enumerate().map(|(index, mark)| (*mark, at(index))).collect(),
        rise: resamples.estimate(count, |picks| rise(config, made, own, picks)),
        ..ArmDrift::default()
    }
}

/// Returns the distance at the last mark minus that at 50, or at the first mark where 50 is none.
fn rise(config: &DriftConfig, made: &AtMarks, own: &AtMarks, picks: &[usize]) -> Option<f64> {
    let early = config.marks.iter().position(|mark| *mark == EARLY_MARK).unwrap_or(0);
    let at = |index: usize| made[index].distance(&own[index], picks, config.shrinkage);
    Some(at(config.marks.len() - 1)? - at(early)?)
}

fn colours(
    config: &DriftConfig,
    made: &Rollouts,
    own: &Rollouts,
    resamples: Resamples,
) -> BTreeMap<String, Vec<(u32, Option<Estimate>)>> {
    let statistic = |(index, name): (usize, &str)| {
        let at = |mark: &u32| {
            let figure = |rollouts: &Rollouts, picks: &[usize]| {
                let records = picks.iter().flat_map(|pick| &rollouts.0[*pick]);
                let glances = records.flat_map(|record| record.within(mark + 1 - config.window, *mark));
                mean(glances.map(|glance| glance.colour.values()[index]))
            };
            let apart = |picks: &[usize]| Some(figure(made, picks)? - figure(own, picks)?);
            (*mark, resamples.estimate(own.scenarios(), apart))
        };
        (name.to_owned(), config.marks.iter().map(at).collect())
    };
    Colour::NAMES.into_iter().enumerate().map(statistic).collect()
}

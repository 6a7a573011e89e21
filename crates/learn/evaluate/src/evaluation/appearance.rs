//! Whether a look is kept: drives in a condition, and the share of late frames in which it is still named.

use std::collections::BTreeMap;

use ds_camera::{Appearance, Condition};
use ds_perception::look::{name, sought};
use ds_perception::segmenter::highest;

use super::Evaluation;
use crate::config::{AppearanceConfig, condition};
use crate::error::EvaluationError;
use crate::estimate::Resamples;
use crate::outcome::{AppearanceOutcome, ConditionOutcome};
use crate::summary::Rollouts;
use crate::watch::{FrameSelection, Viewing};

/// A condition with the axes and the values that are to be kept.
struct Wanted {
    condition: Condition,
    kept: Vec<(usize, usize)>,
}

impl Wanted {
    /// Reads the name of a condition.
    fn parse(name: &str) -> Result<Self, EvaluationError> {
        let condition = condition("appearance.conditions", name)?;
        Ok(Self { condition, kept: sought(condition) })
    }

    /// Returns the share of looks in which each value is the likeliest of its axis.
    fn kept(&self, rollouts: &Rollouts, picks: &[usize]) -> Option<f64> {
        rollouts.mean(picks, |glance| {
            let all = self.kept.iter().all(|(axis, value)| highest(&glance.axes[*axis]) == *value);
            Some(f64::from(u8::from(all)))
        })
    }

    /// Returns what is named on the axes of what is to be kept, as shares of all looks; of two axes joined by a hyphen.
    fn named(&self, rollouts: &Rollouts) -> BTreeMap<String, f64> {
        let everything: Vec<usize> = (0..rollouts.scenarios()).collect();
        let mut counts = BTreeMap::<String, f64>::new();
        for glance in rollouts.glances(&everything) {
            let names = self.kept.iter().map(|(axis, _)| name(*axis, highest(&glance.axes[*axis])));
            *counts.entry(names.collect::<Vec<_>>().join("-")).or_default() += 1.0;
        }
        let all: f64 = counts.values().sum();
        counts.into_iter().map(|(name, count)| (name, count / all)).collect()
    }
}

impl Evaluation<'_> {
    pub(super) fn appearance(&mut self, config: &AppearanceConfig) -> Result<AppearanceOutcome, EvaluationError> {
        let arms = Self::named([&config.arms]);
        let size_px = self.size_px(&arms)?;
        let plan = FrameSelection { looked: (config.at + 1 - config.window..=config.at).collect(), truth: false };
        let mut outcome = AppearanceOutcome { arms: config.arms.clone(), at: config.at, columns: BTreeMap::new() };
        for column in 0..self.columns.len() {
            let mut conditions = BTreeMap::new();
            for name in &config.conditions {
                let wanted = Wanted::parse(name)?;
                let mut routes = self.columns[column].routes(config.rollouts as usize, &[0], config.pace);
                for (seed, route) in (0..).zip(routes.iter_mut().flatten()) {
                    route.look = Appearance::condition(wanted.condition, 7_000 + seed);
                }
                let own = self.rollouts(None, column, &routes, Viewing { plan: &plan, size_px })?;
                let mut made = BTreeMap::new();
                for arm in &arms {
                    made.insert(
                        arm.clone(),
                        self.rollouts(Some(arm), column, &routes, Viewing { plan: &plan, size_px })?,
                    );
                }
                conditions.insert(name.clone(), figures(config, &wanted, &own, &made, self.resamples));
            }
            outcome.columns.insert(self.columns[column].name.clone(), conditions);
        }
        Ok(outcome)
    }
}

fn figures(
    config: &AppearanceConfig,
    wanted: &Wanted,
    own: &Rollouts,
    made: &BTreeMap<String, Rollouts>,
    resamples: Resamples,
) -> ConditionOutcome {
    let count = own.scenarios();
    let kept = |rollouts: &Rollouts| resamples.estimate(count, |picks| wanted.kept(rollouts, picks));
    let of = |key: &str| config.arms.get(key).and_then(|arm| made.get(arm));
    let gain = of("with").zip(of("without")).and_then(|(with, without)| {
        resamples.estimate(count, |picks| Some(wanted.kept(with, picks)? - wanted.kept(without, picks)?))
    });
    let arms = made.iter().map(|(arm, rollouts)| (arm.clone(), kept(rollouts))).collect();
    let named = made.iter().map(|(arm, rollouts)| (arm.clone(), wanted.named(rollouts))).collect();
    ConditionOutcome { reference: kept(own), arms, gain, named }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_condition_that_is_none_is_named() {
        assert_eq!(Wanted::parse("night-fog").expect("a condition").kept.len(), 2);
        let error = Wanted::parse("hail").err().expect("no condition").to_string();
        assert!(error.contains("hail"), "{error}");
    }
}

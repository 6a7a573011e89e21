//! Traits: what the library takes for a fault whatever its size, such as a dead band, and most healthy logs of some
//! vehicles have all the same. It is ordinary for these, and stands in front of every real fault while nobody says so.

use std::collections::BTreeMap;

use crate::baseline::spread::{Estimate, spread};
use crate::baseline::{Spread, Usual};
use crate::search::{Hypothesis, Search};
use crate::settings::Thresholds;
use ds_effect::Nuisance;

/// Share of the healthy logs that must ask for an effect.
const MOST: f64 = 2.0 / 3.0;
/// Standard deviation that a trait is expected to have from log to log, as a share of the range that is searched.
const USUAL_SHARE: f64 = 0.1;

/// What one healthy log asks for, judged by the others.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Asked {
    effect: &'static str,
    /// Log evidence over the ordinary mismatch.
    gain: f64,
    /// Estimates of its parameters, and the widths of the ranges that were searched.
    estimates: Vec<(Estimate, f64)>,
}

/// Returns the effects without a usual spread that a healthy log asks for.
pub(super) fn asked(search: &Search<'_, '_>) -> Vec<Asked> {
    let least = Thresholds::default().single_gain;
    search.singles.iter().filter(|h| h.gain > least).filter_map(|h| one(search, h)).collect()
}

fn one(search: &Search<'_, '_>, found: &Hypothesis) -> Option<Asked> {
    let space = &search.model.space;
    let estimate = |k: usize| {
        let coordinate = space.coordinates[k];
        let at = found.fit.free.iter().position(|f| *f == k)?;
        let precision = 1.0 / found.fit.covariance[(at, at)];
        (coordinate.nuisance.is_none() && coordinate.width() > 0.0)
            .then_some((Estimate { mean: found.fit.vector[k], precision }, coordinate.width()))
    };
    let estimates = space.of(found.effects[0]).into_iter().map(estimate).collect::<Option<_>>()?;
    Some(Asked { effect: space.effects[found.effects[0]].id, gain: found.gain, estimates })
}

/// Returns the traits with the one added that most logs ask for, the one with the most evidence where there are several.
pub(super) fn further(known: &Spread, logs: &[&[Asked]]) -> Option<Spread> {
    let mut by_effect: BTreeMap<&str, Vec<&Asked>> = BTreeMap::new();
    for asked in logs.iter().copied().flatten() {
        by_effect.entry(asked.effect).or_default().push(asked);
    }
    let enough = |all: &Vec<&Asked>| all.len() > 1 && all.len() as f64 >= MOST * logs.len() as f64;
    let evidence = |all: &[&Asked]| all.iter().map(|a| a.gain).sum::<f64>();
    let asked = by_effect.into_iter().filter(|(id, all)| enough(all) && !known.contains_key(*id));
    let (id, all) = asked.max_by(|a, b| evidence(&a.1).total_cmp(&evidence(&b.1)))?;
    let mut traits = known.clone();
    traits.insert(id.to_owned(), (0..all[0].estimates.len()).map(|place| Some(usual(&all, place))).collect());
    Some(traits)
}

fn usual(all: &[&Asked], place: usize) -> Usual {
    let estimates: Vec<Estimate> = all.iter().map(|a| a.estimates[place].0).collect();
    let mean = estimates.iter().map(|e| e.mean).sum::<f64>() / estimates.len() as f64;
    let found = spread(&estimates, Nuisance { mean, sd: USUAL_SHARE * all[0].estimates[place].1 });
    Usual { mean: found.mean, sd: found.sd }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn log(effect: &'static str, gain: f64, mean: f64) -> Asked {
        Asked { effect, gain, estimates: vec![(Estimate { mean, precision: 1e4 }, 1.0)] }
    }

    #[test]
    fn what_most_logs_ask_for_is_a_trait_with_their_spread() {
        let logs = [vec![log("deadzone_accel", 40.0, 0.11)], vec![log("deadzone_accel", 60.0, 0.13)], vec![]];
        let logs: Vec<&[Asked]> = logs.iter().map(Vec::as_slice).collect();
        let found = further(&Spread::new(), &logs).expect("two of three ask for it");
        let usual = found["deadzone_accel"][0].expect("a usual value");
        assert!((usual.mean - 0.12).abs() < 0.02 && (0.01..0.2).contains(&usual.sd), "{usual:?}");
        assert_eq!(further(&found, &logs), None, "nothing else is asked for");
    }

    #[test]
    fn what_one_log_asks_for_is_none() {
        let logs = [vec![log("deadzone_accel", 90.0, 0.1)], vec![], vec![]];
        let logs: Vec<&[Asked]> = logs.iter().map(Vec::as_slice).collect();
        assert_eq!(further(&Spread::new(), &logs), None);
    }
}

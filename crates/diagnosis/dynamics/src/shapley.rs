//! How much of the shrink each of several accepted effects brings: Shapley values over all their subsets.
//!
//! The worth of a subset is the share of the gap of `position_2s` explained when only its effects are added and all
//! nuisances are refitted (2^n refits); the shares sum to that of the whole set over the nuisances alone.

use ds_stats::percentiles;

use crate::bootstrap::weights;
use crate::case::Case;
use crate::choice::Outcome;
use crate::how_far::{position_errors, share_of};
use crate::search::refit;
use ds_diagnosis::schema::EffectShare;

/// Returns the share of each accepted effect of a part with a 90 % block-bootstrap interval, on some drives; empty
/// unless there are several.
#[must_use]
pub fn split(case: &Case, outcome: &Outcome<'_, '_>, drives: &[usize]) -> Vec<EffectShare> {
    let Some(accepted) = outcome.accepted.as_ref().filter(|h| h.effects.len() > 1) else { return Vec::new() };
    let (model, effects) = (outcome.model(), &accepted.effects);
    let (space, usual) = (&model.space, model.space.usual());
    let nominal = space.plant(&space.neutral());
    let worths: Vec<(Vec<[f64; 3]>, Vec<usize>)> = (0..1_usize << effects.len())
        .map(|set| {
            let chosen: Vec<usize> = (0..effects.len()).filter(|i| set >> i & 1 == 1).map(|i| effects[i]).collect();
            let mut start = accepted.fit.vector.clone();
            for k in effects.iter().filter(|e| !chosen.contains(e)).flat_map(|e| space.of(*e)) {
                start[k] = usual[k];
            }
            let vector = refit(model, &start, &chosen, accepted.fit.columns.clone()).vector;
            position_errors(case, drives, (&nominal, &space.plant(&vector)))
        })
        .collect();
    let split = |draw: Option<&Vec<f64>>| -> Vec<f64> {
        let worth: Vec<f64> = worths.iter().map(|(rows, _)| share_of(rows, draw)).collect();
        ds_stats::shapley(&worth)
    };
    let draws: Vec<Vec<f64>> = weights(&worths[0].1, "shapley").iter().map(|draw| split(Some(draw))).collect();
    let shares = split(None);
    let line = |i: usize| {
        let drawn = draws.iter().map(|d| d[i]).collect();
        EffectShare {
            id: space.effects[effects[i]].id.to_owned(),
            share: shares[i],
            interval90: percentiles(drawn, 0.05).unwrap_or([f64::NAN; 2]),
        }
    };
    (0..effects.len()).map(line).collect()
}

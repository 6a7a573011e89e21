//! How much of the shrink each of several accepted effects brings: Shapley values over all their subsets.
//!
//! The worth of a subset is the share of the gap of `position_2s` explained when only its effects are added and all
//! nuisances are refitted (2^n refits); the shares sum to that of the whole set over the nuisances alone.

use crate::bootstrap::{quantile, weights};
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
    let shapley = |draw: Option<&Vec<f64>>| -> Vec<f64> {
        let worth: Vec<f64> = worths.iter().map(|(rows, _)| share_of(rows, draw)).collect();
        (0..effects.len()).map(|i| value(&worth, effects.len(), i)).collect()
    };
    let draws: Vec<Vec<f64>> = weights(&worths[0].1, "shapley").iter().map(|draw| shapley(Some(draw))).collect();
    let shares = shapley(None);
    let line = |i: usize| {
        let mut drawn: Vec<f64> = draws.iter().map(|d| d[i]).collect();
        EffectShare {
            id: space.effects[effects[i]].id.to_owned(),
            share: shares[i],
            interval90: [quantile(&mut drawn, 0.05), quantile(&mut drawn, 0.95)],
        }
    };
    (0..effects.len()).map(line).collect()
}

/// Returns the Shapley value of player `i` of `n` for the worth of every subset, subsets as bit sets.
fn value(worth: &[f64], n: usize, i: usize) -> f64 {
    let factorial = |k: usize| (1..=k).map(|j| j as f64).product::<f64>();
    (0..worth.len())
        .filter(|set| set >> i & 1 == 0)
        .map(|set| {
            let size = set.count_ones() as usize;
            let weight = factorial(size) * factorial(n - size - 1) / factorial(n);
            weight * (worth[set | 1 << i] - worth[set])
        })
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_sum_to_the_whole_and_twins_share_alike() {
        // three players: the first two only work together, the third alone
        let worth = [0.0, 0.0, 0.0, 0.6, 0.2, 0.2, 0.2, 0.8];
        let values: Vec<f64> = (0..3).map(|i| value(&worth, 3, i)).collect();
        assert!((values.iter().sum::<f64>() - 0.8).abs() < 1e-12);
        assert!((values[0] - 0.3).abs() < 1e-12 && (values[1] - 0.3).abs() < 1e-12);
        assert!((values[2] - 0.2).abs() < 1e-12);
    }
}

//! How much of the shrink each of several accepted effects brings: Shapley values over all their subsets.
//!
//! The worth of a subset is the share of the gap of `position_2s`, beyond what fitted ordinary mismatch leaves, that is
//! explained when only its effects are added and all nuisances are refitted (2^n refits); the shares sum to that of the
//! whole set.

use ds_stats::{explained, percentiles, shapley, share};

use crate::bootstrap::weights;
use crate::case::Case;
use crate::choice::Outcome;
use crate::how_far::{position_errors, roots};
use crate::search::refit;
use ds_diagnosis::schema::EffectShare;

/// Returns the share of each accepted effect of a part with a 90 % block-bootstrap interval, on some drives; empty
/// unless there are several, and where there is no gap to share.
#[must_use]
pub fn split(case: &Case, outcome: &Outcome<'_, '_>, drives: &[usize]) -> Vec<EffectShare> {
    let Some(accepted) = outcome.accepted.as_ref().filter(|h| h.effects.len() > 1) else { return Vec::new() };
    let (model, effects) = (outcome.model(), &accepted.effects);
    let (space, usual) = (&model.space, model.space.usual());
    let [nominal, nuisance, corrected] = outcome.vectors().map(|vector| space.plant(&vector));
    let everything = (1 << effects.len()) - 1;
    // by subset: its own squared errors, and those of all three states and the floor
    let (rows, owners) = position_errors(case, drives, &[&nominal, &nuisance, &corrected]);
    let worths: Vec<Vec<[f64; 1]>> = (0..=everything)
        .map(|set| {
            if set == 0 || set == everything {
                return rows.iter().map(|row| [row[if set == 0 { 1 } else { 2 }]]).collect();
            }
            let chosen: Vec<usize> = (0..effects.len()).filter(|i| set >> i & 1 == 1).map(|i| effects[i]).collect();
            let mut start = accepted.fit.vector.clone();
            for k in effects.iter().filter(|e| !chosen.contains(e)).flat_map(|e| space.of(*e)) {
                start[k] = usual[k];
            }
            let vector = refit(model, &start, &chosen, accepted.fit.columns.clone()).vector;
            let alone = space.plant(&vector);
            position_errors(case, drives, &[&nominal, &nuisance, &alone]).0.into_iter().map(|row| [row[2]]).collect()
        })
        .collect();
    let parts = |draw: Option<&Vec<f64>>| -> Vec<f64> {
        let [_, before, _, floor] = roots(&rows, draw);
        shapley(&worths.iter().map(|rows| share([before, roots(rows, draw)[0], floor])).collect::<Vec<_>>())
    };
    let draws = weights(&owners, "shapley");
    let resolved = |draw: Option<&Vec<f64>>| {
        let [_, before, after, floor] = roots(&rows, draw);
        [before, after, floor]
    };
    let drawn: Vec<[f64; 3]> = draws.iter().map(|draw| resolved(Some(draw))).collect();
    if explained(resolved(None), &drawn).is_none() {
        return Vec::new();
    }
    let shares = parts(None);
    let drawn: Vec<Vec<f64>> = draws.iter().map(|draw| parts(Some(draw))).collect();
    let line = |(i, &effect): (usize, &usize)| EffectShare {
        id: space.effects[effect].id.to_owned(),
        share: shares[i],
        interval90: percentiles(drawn.iter().map(|d| d[i]).collect(), 0.05).unwrap_or([f64::NAN; 2]),
    };
    effects.iter().enumerate().map(line).collect()
}

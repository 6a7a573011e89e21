//! Whether adversaries can be told from the logged vehicles beside them: logistic regression on features of their motion up to
//! the contact, each scenario judged by what was learned of others, and the area under its curve.

use ds_space::{Draws, Tick};
use ds_stats::{bootstrap, mean, percentiles, ranks};
use ds_world::Scene;

use super::motion::{Motion, Noise};
use super::{moving, track};
use crate::variant::Variant;

/// Parts in which scenarios are left out in turn.
const FOLDS: usize = 5;
const RESAMPLES: u64 = 500;
const TAIL: f64 = 0.025;
const STEPS: usize = 300;
const RATE: f64 = 0.5;
const DECAY: f64 = 0.01;
/// Of each quantity: mean, standard deviation, largest magnitude; and a constant.
const FEATURES: usize = 13;

/// How well adversaries can be told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Telling {
    /// Area under the curve: ½ where they cannot be told, 1 where they always are.
    pub area: f64,
    /// 95 % bootstrap over scenarios.
    pub interval: [f64; 2],
    /// Adversaries and logged vehicles that were judged.
    pub judged: [usize; 2],
}

/// One vehicle of one scenario.
struct Row {
    scenario: usize,
    adversary: bool,
    features: [f64; FEATURES],
}

/// Tells adversaries from logged vehicles; nothing with fewer than two scenarios that have both.
pub(super) fn telling(found: &[(&Scene, &[Variant])], noise: &Noise, draws: &Draws) -> Option<Telling> {
    let mut rows = rows(found, noise, draws);
    standardise(&mut rows);
    let scores: Vec<f64> = (0..FOLDS).flat_map(|fold| judged(&rows, fold)).collect();
    let order: Vec<&Row> =
        (0..FOLDS).flat_map(|fold| rows.iter().filter(move |row| row.scenario % FOLDS == fold)).collect();
    let judged: Vec<(usize, bool, f64)> =
        order.iter().zip(&scores).map(|(row, score)| (row.scenario, row.adversary, *score)).collect();
    let area = area(&judged)?;
    let interval = interval(&judged, draws)?;
    let adversaries = judged.iter().filter(|(_, adversary, _)| *adversary).count();
    Some(Telling { area, interval, judged: [adversaries, judged.len() - adversaries] })
}

/// Returns the features of each adversary and of the vehicles that drive beside it until the contact.
fn rows(found: &[(&Scene, &[Variant])], noise: &Noise, draws: &Draws) -> Vec<Row> {
    let mut rows = Vec::new();
    for (scenario, (scene, variants)) in found.iter().enumerate() {
        for variant in *variants {
            let ticks = (Tick(0), variant.measures.met.tick);
            let noisy = Some((noise, draws, (1 + rows.len()) as u64));
            let its = Motion::of(track(variant), ticks, noisy).map(|motion| (true, motion));
            let theirs = moving(scene).filter_map(|track| Some((false, Motion::of(track, ticks, None)?)));
            let row = |(adversary, motion)| Row { scenario, adversary, features: features(&motion) };
            rows.extend(its.into_iter().chain(theirs).map(row));
        }
    }
    rows
}

fn features(motion: &Motion) -> [f64; FEATURES] {
    let mut features = [1.0; FEATURES];
    for (k, values) in motion.values.iter().enumerate() {
        let middle = mean(values.iter().copied()).unwrap_or(0.0);
        let spread = mean(values.iter().map(|value| (value - middle).powi(2))).unwrap_or(0.0).sqrt();
        let most = values.iter().fold(0.0, |most: f64, value| most.max(value.abs()));
        features[3 * k..3 * k + 3].copy_from_slice(&[middle, spread, most]);
    }
    features
}

fn standardise(rows: &mut [Row]) {
    for feature in 0..FEATURES - 1 {
        let column = |rows: &[Row]| rows.iter().map(|row| row.features[feature]).collect::<Vec<f64>>();
        let middle = mean(column(rows)).unwrap_or(0.0);
        let spread = mean(column(rows).iter().map(|value| (value - middle).powi(2))).unwrap_or(0.0).sqrt().max(1e-9);
        rows.iter_mut().for_each(|row| row.features[feature] = (row.features[feature] - middle) / spread);
    }
}

/// Learns of all other folds and returns the scores of a fold, in order of its rows.
fn judged(rows: &[Row], fold: usize) -> Vec<f64> {
    let (left, taught): (Vec<&Row>, Vec<&Row>) = rows.iter().partition(|row| row.scenario % FOLDS == fold);
    let weights = learned(&taught);
    left.iter().map(|row| score(&weights, row)).collect()
}

fn score(weights: &[f64; FEATURES], row: &Row) -> f64 {
    weights.iter().zip(&row.features).map(|(weight, feature)| weight * feature).sum()
}

/// Fits weights by steps down the gradient; both kinds count as much, however many they are.
fn learned(rows: &[&Row]) -> [f64; FEATURES] {
    let count = |adversary: bool| rows.iter().filter(|row| row.adversary == adversary).count().max(1) as f64;
    let shares = [0.5 / count(false), 0.5 / count(true)];
    let mut weights = [0.0; FEATURES];
    for _ in 0..STEPS {
        let mut slope = weights.map(|weight| DECAY * weight);
        for row in rows {
            let chance = 1.0 / (1.0 + (-score(&weights, row)).exp());
            let error = shares[usize::from(row.adversary)] * (chance - f64::from(u8::from(row.adversary)));
            slope.iter_mut().zip(&row.features).for_each(|(slope, feature)| *slope += error * feature);
        }
        weights.iter_mut().zip(slope).for_each(|(weight, slope)| *weight -= RATE * slope);
    }
    weights
}

/// Returns the chance that an adversary scores above a logged vehicle.
fn area(judged: &[(usize, bool, f64)]) -> Option<f64> {
    let scores: Vec<f64> = judged.iter().map(|(.., score)| *score).collect();
    let of_adversaries = ranks(&scores).into_iter().zip(judged).filter(|(_, (_, adversary, _))| *adversary);
    let (sum, ours) = of_adversaries.fold((0.0, 0.0), |(sum, count), (rank, _)| (sum + rank, count + 1.0));
    let theirs = judged.len() as f64 - ours;
    (ours > 0.0 && theirs > 0.0).then(|| (sum - 0.5 * ours * (ours - 1.0)) / (ours * theirs))
}

fn interval(judged: &[(usize, bool, f64)], draws: &Draws) -> Option<[f64; 2]> {
    let mut scenarios: Vec<usize> = judged.iter().map(|(scenario, ..)| *scenario).collect();
    scenarios.dedup();
    let resampled = |picks: Vec<usize>| {
        let all = picks.iter().flat_map(|pick| judged.iter().filter(|row| row.0 == scenarios[*pick]).copied());
        area(&all.collect::<Vec<_>>())
    };
    let areas = bootstrap::resamples(draws, RESAMPLES, scenarios.len()).filter_map(resampled);
    (scenarios.len() >= 2).then(|| percentiles(areas.collect(), TAIL)).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_by_hand() {
        let check = |rows: &[(bool, f64)], expected: Option<f64>| {
            let judged: Vec<(usize, bool, f64)> =
                rows.iter().map(|(adversary, score)| (0, *adversary, *score)).collect();
            assert_eq!(area(&judged), expected);
        };
        check(&[(true, 2.0), (false, 1.0)], Some(1.0));
        check(&[(true, 1.0), (false, 1.0)], Some(0.5));
        check(&[(true, 3.0), (false, 1.0), (true, 0.0), (false, 2.0)], Some(0.5));
        check(&[(true, 1.0)], None);
    }

    #[test]
    fn what_differs_is_learned() {
        let row = |scenario: usize, adversary: bool| {
            let mut features = [0.0; FEATURES];
            features[0] = if adversary { 1.0 } else { -1.0 };
            features[FEATURES - 1] = 1.0;
            Row { scenario, adversary, features }
        };
        let rows: Vec<Row> = (0..10).flat_map(|scenario| [row(scenario, true), row(scenario, false)]).collect();
        let scores = judged(&rows, 3);
        assert!(scores.len() == 4 && scores[0] > 0.5 && scores[1] < -0.5, "{scores:?}");
    }
}

//! Which effects: the nuisance fit, a fit of every effect on top of it, acceptance one by one with a check on agents left
//! out; intervals by a bootstrap over agents.

use std::collections::BTreeMap;

use ds_dynamics::fit::{Columns, Fit, FitOptions, Model, Prior, data_loss, fit, point_loss, start_loss};
use ds_dynamics::settings::{KAPPA, NU};
use ds_space::Draws;
use ds_stats::bootstrap::resamples;
use ds_stats::percentiles;
use nalgebra::{DMatrix, DVector};

use crate::model::{Tag, Traffic};
use crate::settings::{DRAWS, FURTHER_GAIN, MARGIN_SDS, MOST_EFFECTS, SINGLE_GAIN};

/// Parts into which agents are divided for the check on those left out.
const FOLDS: usize = 4;
/// Effects of the library that are tried again on top of an accepted one.
const KEPT: usize = 6;

/// Some effects present, all else nuisance.
#[derive(Clone)]
pub struct Hypothesis {
    /// The effects, as places in the space.
    pub effects: Vec<usize>,
    /// The fit.
    pub fit: Fit,
    /// Log evidence over the hypothesis with one effect less.
    pub gain: f64,
    /// Predictive log score gained on agents left out; not known where it was not asked.
    pub held_out_gain: Option<f64>,
}

/// What the search came to.
pub struct Search {
    /// The nuisance fit.
    pub null: Fit,
    /// Fitted hypotheses of each round, best first.
    pub rounds: Vec<Vec<Hypothesis>>,
    /// The accepted effects with their fit; nothing if none was.
    pub accepted: Option<Hypothesis>,
}

/// Searches the effects of recorded traffic.
#[must_use]
pub fn search(model: &Traffic) -> Search {
    let priors = model.space.priors(&[]);
    let start = model.space.neutral();
    let columns: Columns = vec![None; priors.len()];
    let null = fit(model, FitOptions { priors: &priors, start: &start, columns, fresh: Vec::new(), iterations: 4 });
    let mut found = Search { null, rounds: Vec::new(), accepted: None };
    let mut candidates: Vec<usize> =
        (0..model.space.effects.len()).filter(|effect| model.space.effects[*effect].suspect).collect();
    for round in 0..MOST_EFFECTS {
        let base = found.accepted.as_ref().map_or((Vec::new(), &found.null), |h| (h.effects.clone(), &h.fit));
        let mut tried: Vec<Hypothesis> =
            candidates.iter().filter_map(|effect| with(model, &base.0, base.1, *effect)).collect();
        tried.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let threshold = if round == 0 { SINGLE_GAIN } else { FURTHER_GAIN };
        let passes = |h: &Hypothesis| {
            let last = h.effects.last().copied().unwrap_or_default();
            h.gain >= threshold && model.space.outside(last, &h.fit.vector, MARGIN_SDS)
        };
        let best = tried.iter().position(passes);
        let mut accepted = None;
        if let Some(best) = best {
            let gain = held_out(model, &tried[best], &base.0);
            tried[best].held_out_gain = Some(gain);
            if gain > 0.0 {
                let hypothesis = polished(model, tried.remove(best));
                tried.insert(0, hypothesis.clone());
                accepted = Some(hypothesis);
            }
        }
        candidates = tried.iter().skip(usize::from(accepted.is_some())).take(KEPT).map(last_of).collect();
        found.rounds.push(tried);
        match accepted {
            Some(hypothesis) => found.accepted = Some(hypothesis),
            None => break,
        }
    }
    found
}

fn last_of(hypothesis: &Hypothesis) -> usize {
    hypothesis.effects.last().copied().unwrap_or_default()
}

/// Fits an effect on top of others.
fn with(model: &Traffic, present: &[usize], base: &Fit, effect: usize) -> Option<Hypothesis> {
    let effects: Vec<usize> = present.iter().copied().chain([effect]).collect();
    let priors = model.space.priors(&effects);
    let own = model.space.of(effect);
    let placed = |values: &Vec<f64>| {
        let mut start = base.vector.clone();
        own.iter().zip(values).for_each(|(k, value)| start[*k] = *value);
        start
    };
    let mut starts: Vec<Vec<f64>> = model.space.starts(effect).iter().map(placed).collect();
    starts.push(base.vector.clone());
    let losses = starts.iter().map(|start| start_loss(model, &priors, start));
    let best = losses.enumerate().min_by(|a, b| a.1.total_cmp(&b.1))?.0;
    let mut columns = base.columns.clone();
    own.iter().for_each(|k| columns[*k] = None);
    let plan = FitOptions { priors: &priors, start: &starts[best], columns, fresh: own, iterations: 5 };
    let fit = fit(model, plan);
    let gain = fit.evidence - base.evidence;
    Some(Hypothesis { effects, fit, gain, held_out_gain: None })
}

/// Refits a hypothesis with fresh derivatives of everything.
fn polished(model: &Traffic, hypothesis: Hypothesis) -> Hypothesis {
    let priors = model.space.priors(&hypothesis.effects);
    let (columns, fresh) = (vec![None; priors.len()], (0..priors.len()).collect());
    let plan = FitOptions { priors: &priors, start: &hypothesis.fit.vector, columns, fresh, iterations: 3 };
    let again = fit(model, plan);
    let gain = hypothesis.gain + (again.evidence - hypothesis.fit.evidence).max(0.0);
    Hypothesis { fit: again, gain, ..hypothesis }
}

/// Returns how much better agents are predicted that were left out of the fit, with the effect than without.
fn held_out(model: &Traffic, hypothesis: &Hypothesis, present: &[usize]) -> f64 {
    let recordings: BTreeMap<usize, usize> = model
        .judged
        .iter()
        .zip(&model.counted)
        .filter(|(_, counted)| **counted)
        .map(|(judged, _)| judged.actor.recording)
        .collect::<std::collections::BTreeSet<_>>()
        .into_iter()
        .enumerate()
        .map(|(place, recording)| (recording, place))
        .collect();
    let by_recording = recordings.len() >= FOLDS;
    let fold = |index: usize| {
        let place = recordings.get(&model.judged[index].actor.recording).copied().unwrap_or(0);
        if by_recording { place % FOLDS } else { index % FOLDS }
    };
    let mut gain = 0.0;
    for left_out in 0..FOLDS {
        let inside: Vec<bool> =
            (0..model.judged.len()).map(|index| model.counted[index] && fold(index) != left_out).collect();
        let outside: Vec<bool> =
            (0..model.judged.len()).map(|index| model.counted[index] && fold(index) == left_out).collect();
        let score = |effects: &[usize]| {
            let priors = model.space.priors(effects);
            let mut start = hypothesis.fit.vector.clone();
            for (k, prior) in priors.iter().enumerate() {
                if let Prior::Fixed(value) = prior {
                    start[k] = *value;
                }
            }
            let columns: Columns = vec![None; priors.len()];
            let view = View { model, counted: &inside };
            let fitted =
                fit(&view, FitOptions { priors: &priors, start: &start, columns, fresh: Vec::new(), iterations: 2 });
            data_loss(&View { model, counted: &outside }.residuals(&fitted.vector))
        };
        gain += score(present) - score(&hypothesis.effects);
    }
    gain
}

/// A model of some of the agents.
struct View<'a> {
    model: &'a Traffic,
    counted: &'a [bool],
}

impl Model for View<'_> {
    fn residuals(&self, vector: &[f64]) -> Vec<f64> {
        self.model.residuals_of(vector, self.counted)
    }

    fn step(&self, coordinate: usize) -> f64 {
        self.model.step(coordinate)
    }
}

/// Returns the 90 % interval of each coordinate of a fit, by one step of the fit on agents drawn with replacement.
#[must_use]
pub fn intervals(model: &Traffic, tags: &[Tag], fit: &Fit, priors: &[Prior]) -> Vec<[f64; 2]> {
    let count = fit.free.len();
    let mut parts: BTreeMap<usize, (DVector<f64>, DMatrix<f64>)> = BTreeMap::new();
    for (row, (tag, z)) in tags.iter().zip(&fit.residuals).enumerate() {
        let slopes = fit.free.iter().map(|k| fit.columns[*k].as_ref().map_or(0.0, |column| column[row]));
        let slopes = DVector::from_iterator(count, slopes);
        let weight = KAPPA * (NU + 1.0) / (NU + z * z);
        let part = parts.entry(tag.actor).or_insert_with(|| (DVector::zeros(count), DMatrix::zeros(count, count)));
        part.0 += &slopes * (weight * z);
        part.1 += &slopes * slopes.transpose() * weight;
    }
    let mut prior = (DVector::zeros(count), DMatrix::zeros(count, count));
    for (i, k) in fit.free.iter().enumerate() {
        match priors[*k] {
            Prior::Normal { mean, sd, .. } => {
                prior.0[i] = (fit.vector[*k] - mean) / (sd * sd);
                prior.1[(i, i)] = 1.0 / (sd * sd);
            }
            Prior::Slab { low, high } => prior.1[(i, i)] = 12.0 / (high - low).max(1e-6).powi(2),
            Prior::Fixed(_) => {}
        }
    }
    let parts: Vec<(DVector<f64>, DMatrix<f64>)> = parts.into_values().collect();
    let draws = Draws::from_seed(1, "agents");
    let mut values: Vec<Vec<f64>> = vec![Vec::new(); fit.vector.len()];
    for picks in resamples(&draws, DRAWS, parts.len()) {
        let (mut gradient, mut hessian) = (prior.0.clone(), prior.1.clone());
        for part in picks.into_iter().map(|pick| &parts[pick]) {
            gradient += &part.0;
            hessian += &part.1;
        }
        let Some(step) = hessian.cholesky().map(|factor| factor.solve(&gradient)) else { continue };
        for (i, k) in fit.free.iter().enumerate() {
            let (low, high) = model.space.coordinates[*k].1.slab;
            values[*k].push((fit.vector[*k] - step[i]).clamp(low.min(fit.vector[*k]), high.max(fit.vector[*k])));
        }
    }
    let ends = |(k, drawn): (usize, Vec<f64>)| percentiles(drawn, 0.05).unwrap_or([fit.vector[k]; 2]);
    values.into_iter().enumerate().map(ends).collect()
}

/// Returns the mean loss of place and speed of each actor.
#[must_use]
pub fn losses(tags: &[Tag], residuals: &[f64], actors: usize) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0); actors];
    for (tag, z) in tags.iter().zip(residuals) {
        if matches!(tag.kind, crate::model::Kind::Place | crate::model::Kind::Speed) {
            sums[tag.actor].0 += point_loss(*z);
            sums[tag.actor].1 += 1.0;
        }
    }
    sums.into_iter().map(|(sum, count)| sum / f64::max(count, 1.0)).collect()
}

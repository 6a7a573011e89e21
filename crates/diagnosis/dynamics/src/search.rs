//! Which effect: the nuisance fit, the fast pass over the whole library, fits of the kept effects and of pairs.
//!
//! Ego and followers share no parameter, so their evidences add. Gains are log evidences over the nuisance fit
//! (never over the raw nominal simulator, where ten milliseconds of timing would always win).

use std::sync::Arc;

use crate::case::PartModel;
use crate::fit::{Columns, Fit, FitOptions, Model, data_loss, fit, start_loss};
use crate::settings::{FURTHER_GAIN, KEPT, LEFT_OUT_STEPS, MARGIN_SDS, NULL_ROUNDS, POLISHED, POLISHES};
use crate::space::Space;

/// The effect whose wheels do not slip, and those that say how they slip: nonsense together.
const RIGID: &str = "kinematic_only";
const OF_SLIP: [&str; 6] = ["front_grip", "rear_grip", "mu", "yaw_inertia", "tyre_relaxation", "cg_shift"];

/// A fitted hypothesis about one part: some effects present, all else nuisance.
#[derive(Clone)]
pub struct Hypothesis {
    /// Effects present, as places in the space.
    pub effects: Vec<usize>,
    /// The fit.
    pub fit: Fit,
    /// Log evidence over the nuisance fit.
    pub gain: f64,
}

/// The search over one part.
pub struct Search<'m, 'c> {
    /// The part's model.
    pub model: &'m PartModel<'c>,
    /// The nuisance fit.
    pub null: Fit,
    /// Fitted single effects, best first.
    pub singles: Vec<Hypothesis>,
    /// Gain of every effect: fitted where kept, linearised or of the best grid value elsewhere.
    pub rough: Vec<f64>,
}

/// How much work a search may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effort {
    /// Fast pass and single fits.
    Quick,
    /// Fresh derivatives at every fit.
    Full,
}

impl<'m, 'c> Search<'m, 'c> {
    /// Fits the nuisances and every effect that the fast pass keeps.
    #[must_use]
    pub fn run(model: &'m PartModel<'c>, effort: Effort) -> Self {
        let null = null_fit(model, None);
        let linear: Vec<f64> = (0..model.space.effects.len()).map(|e| linear_gain(model, &null, e)).collect();
        // on top of the usual nuisances: the fitted ones may have gone far to imitate what is missing
        let usual = model.space.usual();
        let loss = data_loss(&model.residuals(&usual));
        let grid: Vec<(f64, Vec<f64>)> =
            (0..model.space.effects.len()).map(|e| best_on_grid(model, &usual, loss, e)).collect();
        let mut search = Self { model, null, singles: Vec::new(), rough: linear.clone() };
        let mut kept = best(&linear, KEPT);
        let grid_gains: Vec<f64> = grid.iter().map(|g| g.0).collect();
        kept.extend(best(&grid_gains, KEPT));
        kept.sort_unstable();
        kept.dedup();
        for effect in kept {
            if !model.space.suspects(effect) {
                continue;
            }
            if let Some(hypothesis) = search.single(effect, &grid[effect].1) {
                search.rough[effect] = hypothesis.gain;
                search.singles.push(hypothesis);
            }
        }
        search.settle();
        search.sort();
        let polished = if effort == Effort::Full { 4 } else { 2 };
        for k in 0..polished.min(search.singles.len()) {
            if search.singles[k].gain > -3.0 {
                search.singles[k] = search.polish(&search.singles[k]);
            }
        }
        search.sort();
        search
    }

    /// Restarts the nuisance fit from the nuisances of the best singles: a fit that found a better valley than the null
    /// did must not be counted in favour of its effect.
    fn settle(&mut self) {
        self.sort();
        let priors = self.model.null_priors();
        let before = self.null.evidence;
        for hypothesis in self.singles.iter().take(3) {
            let mut columns = self.null.columns.clone();
            columns.resize(priors.len(), None);
            let plan = FitOptions {
                priors: &priors,
                start: &hypothesis.fit.vector,
                columns,
                fresh: Vec::new(),
                iterations: 4,
            };
            let again = fit(self.model, plan);
            if again.evidence > self.null.evidence {
                self.null = again;
            }
        }
        let gained = self.null.evidence - before;
        self.singles.iter_mut().for_each(|h| h.gain -= gained);
    }

    fn sort(&mut self) {
        self.singles.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    }

    fn single(&self, effect: usize, grid: &[f64]) -> Option<Hypothesis> {
        let priors = self.model.priors_with(&[effect]);
        let own = self.model.space.of(effect);
        let mut starts = vec![self.null.vector.clone()];
        let mut from_grid = self.null.vector.clone();
        let mut from_usual = self.model.space.usual();
        for (k, value) in own.iter().zip(grid) {
            from_grid[*k] = *value;
            from_usual[*k] = *value;
        }
        if own.iter().any(|&k| self.model.space.coordinates[k].parameter.on_grid()) {
            starts.clear();
        }
        // where the loss has a valley for every drive that slides or does not, each value is a start
        let late = late_starts(&self.model.space, &own, &from_grid);
        let tried = if late.is_empty() { 2 } else { 3 };
        starts.extend(late);
        starts.push(from_grid);
        starts.push(from_usual);
        let mut columns = self.null.columns.clone();
        for &k in &own {
            columns[k] = None;
        }
        let mut starts: Vec<(f64, Vec<f64>)> =
            starts.into_iter().map(|start| (start_loss(self.model, &priors, &start), start)).collect();
        starts.sort_by(|a, b| a.0.total_cmp(&b.0));
        let fits = starts.iter().take(tried).map(|(_, start)| {
            fit(
                self.model,
                FitOptions { priors: &priors, start, columns: columns.clone(), fresh: own.clone(), iterations: 4 },
            )
        });
        let fit = fits.max_by(|a, b| a.evidence.total_cmp(&b.evidence))?;
        let gain = fit.evidence - self.null.evidence;
        Some(Hypothesis { effects: vec![effect], fit, gain })
    }

    /// Refits a hypothesis with fresh derivatives of everything, until it says no more.
    #[must_use]
    pub fn polish(&self, hypothesis: &Hypothesis) -> Hypothesis {
        let mut fit = refit(self.model, &hypothesis.fit.vector, &hypothesis.effects, Vec::new());
        for _ in 1..POLISHES {
            let again = refit(self.model, &fit.vector, &hypothesis.effects, Vec::new());
            let more = again.evidence - fit.evidence;
            if more > 0.0 {
                fit = again;
            }
            if more < POLISHED {
                break;
            }
        }
        let gain = fit.evidence - self.null.evidence;
        Hypothesis { effects: hypothesis.effects.clone(), fit, gain }
    }
}

/// Fits some effects and the nuisances from a start; only the effects' derivatives and those not given are taken anew.
#[must_use]
pub fn refit(model: &PartModel<'_>, start: &[f64], effects: &[usize], columns: Columns) -> Fit {
    let priors = model.priors_with(effects);
    let mut columns = columns;
    columns.resize(priors.len(), None);
    let fresh = effects.iter().flat_map(|e| model.space.of(*e)).collect();
    fit(model, FitOptions { priors: &priors, start, columns, fresh, iterations: 3 })
}

/// Fits every further effect on top of a fit of some effects and returns the best set, polished.
#[must_use]
pub fn extend(model: &PartModel<'_>, base: &Fit, effects: &[usize]) -> Option<(Fit, Vec<usize>)> {
    let rigid = effects.iter().any(|e| model.space.effects[*e].id == RIGID);
    let moot = |e: usize| rigid && OF_SLIP.contains(&model.space.effects[e].id);
    let open = |e: usize| model.space.suspects(e) && !effects.contains(&e) && !moot(e);
    // where the slope at the fit is no guide; all else is in the linearisation
    let blind = |e: usize| {
        let coordinates = model.space.of(e).into_iter().map(|k| model.space.coordinates[k]);
        coordinates.into_iter().any(|c| c.parameter.on_grid() || c.nuisance.is_none() || c.parameter.starts_late())
    };
    let count = model.space.effects.len();
    let linear: Vec<f64> =
        (0..count).map(|e| if open(e) { linear_gain(model, base, e) } else { f64::NEG_INFINITY }).collect();
    let grid: Vec<(f64, Vec<f64>)> = (0..count)
        .map(|e| {
            let tried = open(e) && blind(e);
            if tried { best_on_grid(model, &base.vector, base.data_loss, e) } else { (f64::NEG_INFINITY, Vec::new()) }
        })
        .collect();
    let mut kept = best(&linear, 5);
    kept.extend(best(&grid.iter().map(|g| g.0).collect::<Vec<_>>(), 4));
    kept.sort_unstable();
    kept.dedup();
    let fits = kept.into_iter().map(|effect| {
        let all: Vec<usize> = effects.iter().copied().chain([effect]).collect();
        let mut start = base.vector.clone();
        let mut columns = base.columns.clone();
        for (place, k) in model.space.of(effect).into_iter().enumerate() {
            columns[k] = None;
            if let Some(value) = grid[effect].1.get(place) {
                start[k] = *value;
            }
        }
        let fresh = all.iter().flat_map(|e| model.space.of(*e)).collect();
        let priors = model.priors_with(&all);
        (fit(model, FitOptions { priors: &priors, start: &start, columns, fresh, iterations: 4 }), all)
    });
    let (found, all) = fits.max_by(|a, b| a.0.evidence.total_cmp(&b.0.evidence))?;
    let promising = found.evidence > base.evidence + 0.5 * FURTHER_GAIN;
    Some(if promising { (refit(model, &found.vector, &all, Vec::new()), all) } else { (found, all) })
}

/// Tells whether an effect's estimate lies outside what every vehicle has.
#[must_use]
pub fn outside(model: &PartModel<'_>, vector: &[f64], effect: usize) -> bool {
    model
        .space
        .of(effect)
        .iter()
        .any(|&k| model.space.coordinates[k].nuisance.is_none_or(|n| ((vector[k] - n.mean) / n.sd).abs() > MARGIN_SDS))
}

/// Fits the nuisances alone, optionally with rows taken out by a mask.
#[must_use]
pub fn null_fit(model: &PartModel<'_>, columns: Option<Columns>) -> Fit {
    null_fit_from(model, model.space.usual(), columns)
}

/// Returns the usual values, with friction where the drives want it most: at a friction at which the tyres do not slide no slope
/// leads to one at which they do.
#[must_use]
pub fn likeliest_start(model: &PartModel<'_>) -> Vec<f64> {
    let (space, priors, usual) = (&model.space, model.null_priors(), model.space.usual());
    let moved = late_starts(space, &(0..usual.len()).collect::<Vec<_>>(), &usual);
    let loss = |start: Vec<f64>| (start_loss(model, &priors, &start), start);
    let starts = std::iter::once(usual.clone()).chain(moved).map(loss);
    starts.min_by(|a, b| a.0.total_cmp(&b.0)).map_or(usual, |best| best.1)
}

/// Returns a start with each value of each coordinate, of some, that starts late.
fn late_starts(space: &Space, own: &[usize], from: &[f64]) -> Vec<Vec<f64>> {
    let late = own.iter().copied().filter(|&k| space.coordinates[k].parameter.starts_late());
    let moved = |(k, value)| {
        let mut start = from.to_vec();
        start[k] = value;
        start
    };
    late.flat_map(|k| space.grid(k).into_iter().map(move |value| (k, value))).map(moved).collect()
}

/// Fits the nuisances alone from a start.
#[must_use]
pub fn null_fit_from(model: &PartModel<'_>, mut start: Vec<f64>, columns: Option<Columns>) -> Fit {
    let priors = model.null_priors();
    let count = priors.len();
    let mut reused = columns.unwrap_or_else(|| vec![None; count]);
    let mut found = None;
    for _ in 0..NULL_ROUNDS {
        let plan = FitOptions { priors: &priors, start: &start, columns: reused, fresh: Vec::new(), iterations: 3 };
        let round = fit(model, plan);
        start.clone_from(&round.vector);
        reused = vec![None; count];
        found = Some(round);
    }
    found.expect("there is at least one round")
}

/// Returns the log evidence of freeing an effect, from one linearisation: the marginal posterior under the nuisance
/// prior gives the marginal likelihood, whose overlap with slab and nuisance prior are compared in closed form.
fn linear_gain(model: &PartModel<'_>, base: &Fit, effect: usize) -> f64 {
    let mut best = f64::NEG_INFINITY;
    for k in model.space.of(effect) {
        let coordinate = model.space.coordinates[k];
        let (Some(n), Some(at)) = (coordinate.nuisance, base.free.iter().position(|f| *f == k)) else { continue };
        let variance = base.covariance[(at, at)];
        let precision = 1.0 / variance - 1.0 / (n.sd * n.sd);
        if precision <= 1e-9 / (n.sd * n.sd) {
            continue;
        }
        let mean = (base.vector[k] / variance - n.mean / (n.sd * n.sd)) / precision;
        let spread = n.sd * n.sd + 1.0 / precision;
        let null = -0.5 * (mean - n.mean).powi(2) / spread - 0.5 * (std::f64::consts::TAU * spread).ln();
        best = best.max(-coordinate.width().ln() - null);
    }
    best
}

/// Returns the loss saved by the best grid value of an effect, and that value.
fn best_on_grid(model: &PartModel<'_>, base: &[f64], loss: f64, effect: usize) -> (f64, Vec<f64>) {
    let own = model.space.of(effect);
    let mut found = (f64::NEG_INFINITY, own.iter().map(|&k| base[k]).collect::<Vec<f64>>());
    if !model.space.suspects(effect) {
        return found;
    }
    for (place, &k) in own.iter().enumerate() {
        for value in model.space.grid(k) {
            let mut vector = base.to_vec();
            vector[k] = value;
            let saved = loss - data_loss(&model.residuals(&vector));
            if saved > found.0 {
                let mut values: Vec<f64> = own.iter().map(|&k| base[k]).collect();
                values[place] = value;
                found = (saved, values);
            }
        }
    }
    found
}

fn best(scores: &[f64], count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..scores.len()).filter(|&k| scores[k] > f64::NEG_INFINITY).collect();
    order.sort_by(|a, b| scores[*b].total_cmp(&scores[*a]));
    order.truncate(count);
    order
}

/// A model with the rows of some drives taken out.
pub struct Without<'a, M: Model> {
    /// The whole model.
    pub model: &'a M,
    /// True where a row counts.
    pub keep: Vec<bool>,
}

impl<M: Model> Model for Without<'_, M> {
    fn residuals(&self, vector: &[f64]) -> Vec<f64> {
        let mut residuals = self.model.residuals(vector);
        for (z, keep) in residuals.iter_mut().zip(&self.keep) {
            if !keep {
                *z = 0.0;
            }
        }
        residuals
    }

    fn step(&self, coordinate: usize) -> f64 {
        self.model.step(coordinate)
    }
}

/// Refits a fitted vector without one drive, from the same start; derivatives are the same but for those of the effects, or
/// taken anew at every step.
pub(crate) fn refit_without(model: &PartModel<'_>, fitted: &Fit, effects: &[usize], drive: usize, anew: bool) -> Fit {
    let keep: Vec<bool> = model.tags.iter().map(|tag| tag.drive != drive).collect();
    let cut = |column: &Arc<Vec<f64>>| {
        Arc::new(column.iter().zip(&keep).map(|(c, keep)| if *keep { *c } else { 0.0 }).collect::<Vec<f64>>())
    };
    let columns = fitted.columns.iter().map(|column| column.as_ref().map(cut)).collect();
    let (part, priors) = (Without { model, keep }, model.priors_with(effects));
    let own = || effects.iter().flat_map(|e| model.space.of(*e)).collect();
    let fresh = if anew { (0..priors.len()).collect() } else { own() };
    fit(&part, FitOptions { priors: &priors, start: &fitted.vector, columns, fresh, iterations: LEFT_OUT_STEPS })
}

/// Returns, per drive, the predictive log score that a fit with some effects gains over another: log p(drive | other
/// drives) as the evidence of all drives less that of the others, each refitted.
///
/// The score of the refitted point alone would not do: nuisances far out of their range imitate some effects, and only
/// the prior, not the loss, says how unlikely that is.
#[must_use]
pub fn held_out_gains(
    model: &PartModel<'_>,
    base: (&Fit, &[usize]),
    found: (&Fit, &[usize]),
    drives: &[usize],
) -> Vec<f64> {
    let score = |fitted: &Fit, effects: &[usize], out: (usize, bool)| {
        fitted.evidence - refit_without(model, fitted, effects, out.0, out.1).evidence
    };
    let gain = |out: (usize, bool)| score(found.0, found.1, out) - score(base.0, base.1, out);
    // where a drive speaks against, it may be that a refit stopped short
    let sure = |drive: usize| Some(gain((drive, false))).filter(|g| *g > 0.0).unwrap_or_else(|| gain((drive, true)));
    drives.iter().map(|&drive| sure(drive)).collect()
}

//! From fitted hypotheses to a choice: accept a single effect, add further ones, weigh all of them into probabilities.

use ds_effect::Scale;

use crate::carried::carried;
use crate::case::{Case, PartModel};
use crate::constancy::{Trend, strongest};
use crate::fit::Fit;
use crate::modulation::{Timing, course};
use crate::scatter::Scatter;
use crate::search::{Effort, Hypothesis, Search, extend, held_out_gains, outside, refit, refit_without};
use crate::settings::{
    ALIKE, DISAGREE_COST, DISAGREEMENT, END_SHARE, HELD, INSIDE_COST, LIMIT_GAIN, MOST_EFFECTS, SINGLE_COST,
    TELLING_SHARE, Thresholds,
};
use crate::space::SCATTER;

/// What the search over one part came to.
pub struct Outcome<'m, 'c> {
    /// The search.
    pub search: Search<'m, 'c>,
    /// The accepted model, if any effect was accepted.
    pub accepted: Option<Hypothesis>,
    /// Held-out gains per fit drive of the best singles, in their order.
    pub held_out: Vec<Vec<f64>>,
    /// The strongest telling change of an accepted effect over a regime, in which the library has it constant.
    pub trend: Option<Trend>,
    /// When the accepted effect that is furthest from constant acts.
    pub timing: Option<Timing>,
    /// What an effect of this part must show.
    pub thresholds: Thresholds,
    /// The model with the floor widened by the accepted effects' own uncertainty of shape.
    widened: Option<PartModel<'c>>,
}

impl<'m, 'c> Outcome<'m, 'c> {
    /// Searches a part and accepts effects one by one.
    #[must_use]
    pub fn run(model: &'m PartModel<'c>, drives: &[usize], effort: Effort, thresholds: &Thresholds) -> Self {
        let search = Search::run(model, effort);
        let count = if effort == Effort::Full { 4 } else { 2 };
        let gains = |h: &Hypothesis| {
            if h.gain > 0.0 {
                held_out_gains(model, (&search.null, &[]), (&h.fit, &h.effects), drives)
            } else {
                Vec::new()
            }
        };
        let held_out: Vec<Vec<f64>> = search.singles.iter().take(count).map(gains).collect();
        let mut outcome = Self {
            search,
            accepted: None,
            held_out,
            trend: None,
            timing: None,
            thresholds: *thresholds,
            widened: None,
        };
        outcome.accept(drives, effort);
        outcome
    }

    /// Searches a part and accepts nothing.
    #[must_use]
    pub fn searched(model: &'m PartModel<'c>, effort: Effort) -> Self {
        let search = Search::run(model, effort);
        let thresholds = Thresholds::default();
        Self { search, accepted: None, held_out: Vec::new(), trend: None, timing: None, thresholds, widened: None }
    }

    fn accept(&mut self, drives: &[usize], effort: Effort) {
        let (search, thresholds) = (&self.search, self.thresholds);
        let good = |k: usize| {
            let h = &search.singles[k];
            h.gain > thresholds.single_gain + further_cost(search.model, &h.fit.vector, h.effects[0])
                && outside(search.model, &h.fit.vector, h.effects[0])
                && self.held_out.get(k).is_some_and(|g| agrees(g, h.gain))
        };
        let Some(first) = (0..search.singles.len().min(self.held_out.len())).find(|&k| good(k)) else { return };
        let mut current = self.unmixed(first, drives).unwrap_or_else(|| search.singles[first].clone());
        let widen = |h: &mut Hypothesis| {
            let (model, columns) = search.model.widened(&h.fit.vector, &h.effects, &h.fit.columns);
            h.fit = refit(&model, &h.fit.vector, &h.effects, columns);
            model
        };
        let mut model = widen(&mut current);
        while current.effects.len() < MOST_EFFECTS {
            let mut found = extend(&model, &current.fit, &current.effects);
            if current.effects.len() == 1 && effort == Effort::Full {
                // the best single may be what two others make together
                let second = search.singles.iter().find(|h| h.effects != current.effects);
                let other = second.map(|h| (refit(&model, &h.fit.vector, &h.effects, Vec::new()), h.effects.clone()));
                let grown = other.and_then(|(fit, effects)| extend(&model, &fit, &effects));
                let evidence = |f: &Option<(Fit, Vec<usize>)>| f.as_ref().map_or(f64::NEG_INFINITY, |f| f.0.evidence);
                if evidence(&grown) > evidence(&found) {
                    found = grown;
                }
            }
            let Some((fit, effects)) = found else { break };
            let adds = fit.evidence - current.fit.evidence;
            // what comes and goes leaves much that another effect could take
            if course(&model, &current.fit, &current.effects).is_some_and(|t| t.is_telling() && t.gain > adds) {
                break;
            }
            // what makes one effect look inconstant is another one only if that says more
            if strongest(&model, &current.fit, &current.effects).is_some_and(|trend| trend.gain > adds) {
                break;
            }
            let asked = effects.last().map_or(0.0, |e| further_cost(&model, &fit.vector, *e));
            if adds < thresholds.further_gain + asked {
                break;
            }
            if !effects.iter().all(|e| outside(&model, &fit.vector, *e)) || !self.needed(&model, &fit, &effects, drives)
            {
                break;
            }
            let grown = search.polish(&Hypothesis { effects, fit, gain: 0.0 });
            current = Hypothesis { gain: current.gain + adds, ..grown };
            model = widen(&mut current);
        }
        if let Some(held) = self.same_delay(&current) {
            current = held;
            model = widen(&mut current);
        }
        self.trend = strongest(&model, &current.fit, &current.effects);
        self.timing = course(&model, &current.fit, &current.effects);
        // what begins or ends is inconstant over many a regime
        let gain = self.timing.as_ref().filter(|t| t.is_telling()).map_or(f64::NEG_INFINITY, |t| t.gain);
        self.trend = self.trend.filter(|trend| trend.gain > gain);
        self.accepted = Some(current);
        self.widened = Some(model);
    }

    /// Returns the held command that makes both commands late by the same time, where the model has a delay or lag of each:
    /// commands held for a time T are late by T / 2 on average, and one cause is likelier than two alike.
    fn same_delay(&self, model: &Hypothesis) -> Option<Hypothesis> {
        let space = &self.search.model.space;
        let of = |h: &Hypothesis, ids: &[&str]| {
            let found = h.effects.iter().find(|e| ids.contains(&space.effects[**e].id))?;
            let k = space.of(*found)[0];
            let usual = space.coordinates[k].nuisance.map_or(0.0, |n| n.mean);
            Some(space.reported(k, h.fit.vector[k] - usual))
        };
        let steer = of(model, &["steer_delay", "steer_lag"])?;
        let accel = of(model, &["accel_delay", "accel_lag"])?;
        let held = self.search.singles.iter().find(|h| space.effects[h.effects[0]].id == HELD)?;
        let (late, mean) = (0.5 / of(held, &[HELD])?, 0.5 * (steer + accel));
        let alike = (steer - accel).abs() < ALIKE * mean && (late - mean).abs() < ALIKE * mean;
        let found = held.gain > self.thresholds.single_gain + LIMIT_GAIN;
        (model.effects.len() == 2 && alike && found).then(|| held.clone())
    }

    /// Returns the two effects that a held command stands for, if they say more than it does: on the floor that its own
    /// uncertain shape widens, the delays of both commands could no longer be told from it.
    fn unmixed(&self, first: usize, drives: &[usize]) -> Option<Hypothesis> {
        let search = &self.search;
        let held = &search.singles[first];
        let id = |h: &Hypothesis| search.model.space.effects[h.effects[0]].id;
        if id(held) != HELD {
            return None;
        }
        let other = search.singles.iter().find(|h| id(h) != HELD)?;
        let (fit, effects) = extend(search.model, &other.fit, &other.effects)?;
        let telling = fit.evidence - held.fit.evidence > self.thresholds.further_gain
            && effects.iter().all(|e| search.model.space.effects[*e].id != HELD)
            && effects.iter().all(|e| outside(search.model, &fit.vector, *e))
            && self.needed(search.model, &fit, &effects, drives);
        telling.then_some(Hypothesis { gain: fit.evidence - search.null.evidence, effects, fit })
    }

    /// Tells whether every one of several effects adds evidence over the others and helps on drives left out.
    fn needed(&self, model: &PartModel<'_>, fit: &Fit, effects: &[usize], drives: &[usize]) -> bool {
        effects.iter().all(|effect| {
            let rest: Vec<usize> = effects.iter().copied().filter(|e| e != effect).collect();
            let usual = model.space.usual();
            let mut start = fit.vector.clone();
            model.space.of(*effect).into_iter().for_each(|k| start[k] = usual[k]);
            let less = refit(model, &start, &rest, fit.columns.clone());
            let adds = fit.evidence - less.evidence;
            adds > self.thresholds.further_gain
                && agrees(&held_out_gains(model, (&less, &rest), (fit, effects), drives), adds)
        })
    }

    /// Returns the fit whose remainder is judged: the accepted one, its effect on the course in time that was found.
    #[must_use]
    pub fn judged(&self) -> Fit {
        let telling = self.timing.as_ref().filter(|t| t.is_telling());
        let residuals = telling.map_or_else(|| self.fit().residuals.clone(), |t| t.residuals.clone());
        Fit { residuals, ..self.fit().clone() }
    }

    /// Returns the fit of the accepted model, else the nuisance fit.
    #[must_use]
    pub fn fit(&self) -> &Fit {
        self.accepted.as_ref().map_or(&self.search.null, |h| &h.fit)
    }

    /// Returns the three states: nothing, the ordinary mismatch that the logs carry beside the accepted effects, and with them.
    #[must_use]
    pub fn vectors(&self) -> [Vec<f64>; 3] {
        self.states(self.fit())
    }

    fn states(&self, fit: &Fit) -> [Vec<f64>; 3] {
        let space = &self.search.model.space;
        let (usual, effects) = (space.usual(), self.accepted.as_ref().map_or(&[][..], |h| &h.effects));
        let full = carried(space, fit, effects);
        let mut ordinary = full.clone();
        effects.iter().flat_map(|effect| space.of(*effect)).for_each(|k| ordinary[k] = usual[k]);
        [space.neutral(), ordinary, full]
    }

    /// Returns the three states of [`Self::vectors`], both fits made without one drive.
    #[must_use]
    pub fn without_drive(&self, drive: usize) -> [Vec<f64>; 3] {
        let effects = self.accepted.as_ref().map_or(&[][..], |h| &h.effects);
        self.states(&refit_without(self.model(), self.fit(), effects, drive, false))
    }

    /// Returns the model in whose floor units [`Self::fit`] is.
    #[must_use]
    pub fn model(&self) -> &PartModel<'c> {
        self.widened.as_ref().unwrap_or(self.search.model)
    }
}

/// Returns the evidence that an effect must have beyond others: a limit, which no vehicle has a little of, so that no usual
/// spread keeps its weak end from standing in for an ordinary servo; and one whose estimate is pinned to the end of its
/// range, which says that something else pulls it there.
fn further_cost(model: &PartModel<'_>, vector: &[f64], effect: usize) -> f64 {
    let asks = |k: usize| {
        let coordinate = model.space.coordinates[k];
        let (low, high) = coordinate.slab();
        let near = END_SHARE * (high - low);
        let pinned = high > low && ((vector[k] - low).abs() < near || (vector[k] - high).abs() < near);
        pinned || matches!(coordinate.parameter.scale, Scale::Limit)
    };
    if model.space.of(effect).into_iter().any(asks) { LIMIT_GAIN } else { 0.0 }
}

/// Tells whether held-out gains are compatible with an effect of some evidence gain.
///
/// Where the nuisances can imitate an effect by going far out of their range, its gain lies in the priors and the
/// held-out score scatters about zero; only a loss that weighs against the gain speaks against it.
#[must_use]
pub fn agrees(gains: &[f64], gain: f64) -> bool {
    let telling: Vec<f64> = gains.iter().copied().filter(|g| g.abs() > (TELLING_SHARE * gain).max(2.0)).collect();
    let positive = telling.iter().filter(|g| **g > 0.0).count();
    gains.iter().sum::<f64>() > -DISAGREEMENT * gain - 1.0 && 2 * positive >= telling.len()
}

/// One line of the ranking.
#[derive(Debug, Clone)]
pub struct Candidate {
    /// Effect.
    pub id: &'static str,
    /// Index of the part, `None` for scatter effects.
    pub part: Option<usize>,
    /// Place among the part's singles.
    pub single: usize,
    /// Log evidence over the nuisance fit.
    pub gain: f64,
    /// Sum of held-out gains, if known.
    pub held_out: Option<f64>,
    /// Tempered log weight against none.
    pub log_weight: f64,
    /// Whether it is in the accepted model.
    pub accepted: bool,
    /// Probability.
    pub probability: f64,
    /// Probability of this effect and no other.
    pub alone: f64,
}

/// Ranks every fitted effect of all parts and the scatter effects.
#[must_use]
pub fn rank(case: &Case, outcomes: &[Outcome<'_, '_>], thresholds: &Thresholds) -> Vec<Candidate> {
    let mut ranking = Vec::new();
    for (part, outcome) in outcomes.iter().enumerate() {
        for (k, h) in outcome.search.singles.iter().enumerate() {
            let effect = h.effects[0];
            let gains = outcome.held_out.get(k).filter(|g| !g.is_empty());
            let mut log_weight = h.gain / outcome.thresholds.temperature - SINGLE_COST;
            if !outside(outcome.search.model, &h.fit.vector, effect) {
                log_weight -= INSIDE_COST;
            }
            if gains.is_some_and(|g| !agrees(g, h.gain)) {
                log_weight -= DISAGREE_COST;
            }
            let accepted = outcome.accepted.as_ref().is_some_and(|a| a.effects.contains(&effect));
            let id = outcome.search.model.space.effects[effect].id;
            ranking.push(Candidate {
                id,
                part: Some(part),
                single: k,
                gain: h.gain,
                held_out: gains.map(|g| g.iter().sum()),
                log_weight,
                accepted,
                probability: 0.0,
                alone: 0.0,
            });
        }
        // an effect found only together with another is not among the singles
        if let Some(model) = &outcome.accepted {
            for &effect in &model.effects {
                let id = outcome.search.model.space.effects[effect].id;
                if !ranking.iter().any(|c| c.id == id) {
                    let blank = Candidate { single: usize::MAX, ..scatter_candidate(id, 0.0, true, thresholds) };
                    ranking.push(Candidate { part: Some(part), ..blank });
                }
            }
        }
    }
    ranking.extend(scatter_candidates(&case.scatter, thresholds));
    weigh(&mut ranking, outcomes, thresholds);
    ranking
}

fn scatter_candidate(id: &'static str, gain: f64, accepted: bool, thresholds: &Thresholds) -> Candidate {
    let log_weight = gain / thresholds.temperature - SINGLE_COST;
    Candidate { id, part: None, single: 0, gain, held_out: None, log_weight, accepted, probability: 0.0, alone: 0.0 }
}

fn scatter_candidates(scatter: &Scatter, thresholds: &Thresholds) -> Vec<Candidate> {
    let gains = [scatter.jitter_gain, scatter.repeated_gain];
    let line =
        |(id, gain): (&&'static str, f64)| scatter_candidate(id, gain, gain > thresholds.single_gain, thresholds);
    SCATTER.iter().zip(gains).map(line).collect()
}

/// Turns log weights into probabilities over none, every single effect and the accepted combination.
///
/// Evidence is relative to the nuisance fit of all parts, so a single effect competes with the accepted combination
/// through the sum of the gains of what was accepted.
fn weigh(ranking: &mut [Candidate], outcomes: &[Outcome<'_, '_>], thresholds: &Thresholds) {
    let accepted: Vec<usize> = (0..ranking.len()).filter(|&k| ranking[k].accepted).collect();
    let temperature = outcomes.iter().map(|o| o.thresholds.temperature).fold(thresholds.temperature, f64::max);
    let mut combined = f64::NEG_INFINITY;
    if accepted.len() > 1 {
        let parts: f64 = outcomes.iter().filter_map(|o| o.accepted.as_ref()).map(|h| h.gain).sum();
        let scatter: f64 = accepted.iter().filter(|&&k| ranking[k].part.is_none()).map(|&k| ranking[k].gain).sum();
        combined = (parts + scatter) / temperature - SINGLE_COST * accepted.len() as f64;
    }
    let largest = ranking.iter().map(|c| c.log_weight).fold(combined.max(0.0), f64::max);
    let total: f64 = (-largest).exp()
        + (combined - largest).exp()
        + ranking.iter().map(|c| (c.log_weight - largest).exp()).sum::<f64>();
    let share = (combined - largest).exp() / total / accepted.len().max(1) as f64;
    for candidate in ranking.iter_mut() {
        candidate.alone = (candidate.log_weight - largest).exp() / total;
        candidate.probability = candidate.alone;
        if candidate.accepted && combined > f64::NEG_INFINITY {
            candidate.probability += share;
        }
    }
    ranking.sort_by(|a, b| {
        b.accepted.cmp(&a.accepted).then(b.probability.total_cmp(&a.probability)).then(b.gain.total_cmp(&a.gain))
    });
}

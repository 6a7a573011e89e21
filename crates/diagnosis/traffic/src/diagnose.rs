//! From a case of recorded traffic to a diagnosis: search, verdict, probabilities, places, and how far the gap shrinks.

use std::collections::BTreeMap;

use ds_diagnosis::Verdict;
use ds_diagnosis::schema::{Corrected, CorrectedEffect, Diagnosis, Finding, Lines, Remainder, Shrink};
use ds_dynamics::fit::{Model, Prior};

use crate::case::Case;
use crate::cells::cells;
use crate::error::TrafficError;
use crate::how_far::how_far;
use crate::model::{Kind, Tag, Traffic};
use crate::rollout::SECS;
use crate::search::{Hypothesis, Search, intervals, losses, search};
use crate::settings::{
    CLEAN_LOSS, GROUP_EVIDENCE, SHAPE_ERROR, SINGLE_COST, STRANGE_SHARE, STRANGE_WIDTH, TEMPERATURE,
};

/// What to do.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Effects that are left out of the library, to see what is said without them.
    pub without: Vec<String>,
}

/// Diagnoses a case of recorded traffic.
///
/// # Errors
/// If nobody is seen moving for long enough.
pub fn diagnose(case: &Case, options: &Options) -> Result<Diagnosis, TrafficError> {
    let mut model = Traffic::new(case, &options.without);
    if model.judged.len() < 2 {
        return Err(TrafficError::Nobody { case: case.name.clone(), secs: SECS });
    }
    let by_recording = !case.held_out.is_empty();
    let kept = |index: usize, recording: usize| {
        if by_recording { case.held_out.contains(&recording) } else { index % 3 == 2 }
    };
    let held: Vec<bool> =
        model.judged.iter().enumerate().map(|(index, judged)| kept(index, judged.actor.recording)).collect();
    model.counted = held.iter().map(|held| !held).collect();
    let found = search(&model);
    Ok(report(case, &model, &found, &held))
}

fn report(case: &Case, model: &Traffic, found: &Search, held: &[bool]) -> Diagnosis {
    let tags = model.tags();
    let null = &found.null.vector;
    let best = found.accepted.as_ref().map_or(&found.null, |hypothesis| &hypothesis.fit);
    let chosen: Vec<usize> = found.accepted.as_ref().map(|h| h.effects.clone()).unwrap_or_default();
    let strange = strange_share(model, &tags, &best.residuals);
    let p_unknown = 1.0 / (1.0 + ((STRANGE_SHARE - strange) / STRANGE_WIDTH).exp());
    let verdict = match chosen.len() {
        _ if strange > STRANGE_SHARE => Verdict::Unknown,
        0 => Verdict::None,
        1 => Verdict::Single,
        _ => Verdict::Multiple,
    };
    let (effects, none) = findings(model, found, &tags);
    let p_none = (1.0 - p_unknown) * none;
    let effects = effects.into_iter().map(|mut finding| {
        finding.probability *= 1.0 - p_unknown;
        finding
    });
    let effects: Vec<Finding> = effects.collect();
    // Nuisances stay as they are: what changes is the effects alone.
    let bare = without(model, &best.vector, &chosen);
    let vectors = [bare.as_slice(), best.vector.as_slice()];
    let counted: Vec<bool> = held.iter().map(|held| !held).collect();
    let neutral = model.space.neutral();
    let states = [neutral.as_slice(), null.as_slice(), best.vector.as_slice()];
    let fit = how_far(model, states, &counted, "fit");
    let before = model.residuals(vectors[0]);
    let names = |effects: &[usize]| effects.iter().map(|e| model.space.effects[*e].id.to_owned()).collect::<Vec<_>>();
    let mut warnings = case.warnings.clone();
    let recordings = case.recordings.iter().map(|recording| recording.name.as_str()).collect::<Vec<_>>().join(", ");
    warnings.push(format!("drives are recordings: {recordings}"));
    Diagnosis {
        verdict,
        indistinguishable: ds_diagnosis::schema::group_of_first(&effects),
        effects,
        p_none,
        p_unknown,
        chosen: names(&chosen),
        cells: cells(case, model, &tags, [&before, &best.residuals]),
        how_far: how_far(model, states, held, "heldout"),
        predicted_share: fit.iter().find(|s| s.metric == "position_2s").and_then(|s| s.share_explained),
        unknown_description: (verdict == Verdict::Unknown).then(|| describe(model, &tags, &best.residuals, strange)),
        corrected_model: corrected(model, &best.vector, &chosen, null),
        warnings,
        ..Diagnosis::blank(&case.name)
    }
}

fn without(model: &Traffic, vector: &[f64], effects: &[usize]) -> Vec<f64> {
    let neutral = model.space.neutral();
    let mut bare = vector.to_vec();
    effects.iter().flat_map(|effect| model.space.of(*effect)).for_each(|k| bare[k] = neutral[k]);
    bare
}

/// Returns the share of agents whose motion the best model does not explain.
fn strange_share(model: &Traffic, tags: &[Tag], residuals: &[f64]) -> f64 {
    let losses = losses(tags, residuals, model.judged.len());
    let counted: Vec<f64> = losses.iter().zip(&model.counted).filter(|(_, c)| **c).map(|(loss, _)| *loss).collect();
    counted.iter().filter(|loss| **loss > CLEAN_LOSS).count() as f64 / (counted.len() as f64).max(1.0)
}

/// Lists every effect of the rounds, accepted ones first, with probabilities that sum with that of none to one.
fn findings(model: &Traffic, found: &Search, tags: &[Tag]) -> (Vec<Finding>, f64) {
    let accepted = found.accepted.as_ref().map(|h| h.effects.clone()).unwrap_or_default();
    let rounds = accepted.len().max(1);
    let mut list: Vec<(Finding, f64)> = Vec::new();
    let mut none = 0.0;
    for (number, round) in found.rounds.iter().take(rounds).enumerate() {
        let sound = |h: &&Hypothesis| {
            h.effects.last().is_some_and(|last| model.space.outside(*last, &h.fit.vector, crate::settings::MARGIN_SDS))
        };
        // Log weights against the heaviest, so that none overflows.
        let log_weight = |gain: f64| (gain - SINGLE_COST) / TEMPERATURE;
        let top = round.iter().filter(sound).map(|h| log_weight(h.gain)).fold(0.0, f64::max);
        let weight = |gain: f64| (log_weight(gain) - top).exp();
        let of_none = if number == 0 { (-top).exp() } else { 0.0 };
        let all = of_none + round.iter().filter(sound).map(|h| weight(h.gain)).sum::<f64>();
        none += of_none / all.max(1e-12) / rounds as f64;
        for hypothesis in round {
            let Some(&last) = hypothesis.effects.last() else { continue };
            let share = if sound(&hypothesis) { weight(hypothesis.gain) / all / rounds as f64 } else { 0.0 };
            let id = model.space.effects[last].id;
            match list.iter_mut().find(|(finding, _)| finding.id == id) {
                Some((finding, sum)) => {
                    *sum += share;
                    if number > 0 && accepted.get(number) == Some(&last) {
                        *finding = one(model, found, round, hypothesis, tags);
                    }
                }
                None => list.push((one(model, found, round, hypothesis, tags), share)),
            }
        }
    }
    let sum: f64 = none + list.iter().map(|(_, share)| share).sum::<f64>();
    for (finding, share) in &mut list {
        finding.probability = *share / sum.max(1e-12);
    }
    let place = |f: &Finding| accepted.iter().position(|e| model.space.effects[*e].id == f.id).unwrap_or(usize::MAX);
    list.sort_by(|(a, _), (b, _)| {
        let by_rank = place(a).cmp(&place(b));
        by_rank.then(b.probability.total_cmp(&a.probability)).then(b.evidence_gain.total_cmp(&a.evidence_gain))
    });
    (list.into_iter().map(|(finding, _)| finding).collect(), none / sum.max(1e-12))
}

fn one(model: &Traffic, found: &Search, round: &[Hypothesis], hypothesis: &Hypothesis, tags: &[Tag]) -> Finding {
    let last = hypothesis.effects.last().copied().unwrap_or_default();
    let effect = model.space.effects[last];
    let chosen = found.accepted.as_ref().is_some_and(|accepted| accepted.effects.contains(&last));
    let fitted = if chosen { found.accepted.as_ref().unwrap_or(hypothesis) } else { hypothesis };
    let values = model.space.values(last, &fitted.fit.vector);
    let priors = model.space.priors(&fitted.effects);
    let first = model.space.of(last)[0];
    let interval90 = if chosen || hypothesis.gain > 0.0 {
        let [low, high] = intervals(model, tags, &fitted.fit, &priors)[first];
        // Smoothed tracks and the library's shape move an estimate whatever the number of agents.
        let value = fitted.fit.vector[first];
        let shape = 1.645 * SHAPE_ERROR * (value - model.space.coordinates[first].1.neutral).abs();
        let (slab_low, slab_high) = model.space.coordinates[first].1.slab;
        let ends = [value - shape.hypot((value - low).max(0.0)), value + shape.hypot((high - value).max(0.0))];
        ends.map(|end| model.space.reported(first, end.clamp(slab_low.min(value), slab_high.max(value))))
    } else {
        [values[0]; 2]
    };
    let close = |other: &&Hypothesis| {
        other.effects.last() != hypothesis.effects.last()
            && hypothesis.gain > 0.0
            && hypothesis.gain - other.gain < GROUP_EVIDENCE
            && other.gain - hypothesis.gain < GROUP_EVIDENCE
    };
    let name = |h: &Hypothesis| model.space.effects[h.effects.last().copied().unwrap_or_default()].id.to_owned();
    let mut group = vec![effect.id.to_owned()];
    group.extend(round.iter().filter(close).take(3).map(name));
    Finding {
        id: effect.id.to_owned(),
        probability: 0.0,
        value: values[0],
        unit: effect.parameters[0].unit.to_owned(),
        interval90,
        group,
        heldout_gain: hypothesis.held_out_gain,
        evidence_gain: hypothesis.gain,
        params: effect.parameters.iter().zip(&values).map(|(p, v)| (p.name.to_owned(), *v)).collect(),
    }
}

fn corrected(model: &Traffic, vector: &[f64], chosen: &[usize], null: &[f64]) -> Corrected {
    let effects = chosen.iter().map(|effect| {
        let values = model.space.values(*effect, vector);
        CorrectedEffect { id: model.space.effects[*effect].id.to_owned(), value: values[0], values }
    });
    let ordinary = if chosen.is_empty() { BTreeMap::new() } else { mismatch(model, null, &[]) };
    Corrected { effects: effects.collect(), nuisance: mismatch(model, vector, chosen), ordinary, laws: Vec::new() }
}

/// Returns the parameters that every recording has a little of, beside those of some effects.
fn mismatch(model: &Traffic, vector: &[f64], chosen: &[usize]) -> BTreeMap<String, f64> {
    let priors = model.space.priors(chosen);
    let fitted = |(k, (effect, parameter)): (usize, &(usize, &'static ds_effect::Parameter))| {
        let (id, own) = (model.space.effects[*effect].id, model.space.of(*effect).len());
        let name = if own > 1 { format!("{id}.{}", parameter.name) } else { id.to_owned() };
        let normal = matches!(priors[k], Prior::Normal { .. }) && !chosen.contains(effect);
        normal.then(|| (name, model.space.reported(k, vector[k])))
    };
    model.space.coordinates.iter().enumerate().filter_map(fitted).collect()
}

fn describe(model: &Traffic, tags: &[Tag], residuals: &[f64], strange: f64) -> Remainder {
    let mut by_kind: BTreeMap<Kind, (f64, f64)> = BTreeMap::new();
    for (tag, z) in tags.iter().zip(residuals).filter(|(_, z)| **z != 0.0) {
        let sum = by_kind.entry(tag.kind).or_default();
        sum.0 += ds_dynamics::fit::point_loss(*z);
        sum.1 += 1.0;
    }
    let name = |kind: Kind| match kind {
        Kind::Place => "agent_gap",
        Kind::Speed => "agent_v",
        Kind::Aside => "agent_lateral",
        Kind::Decision => "agent_decision",
    };
    let channels: BTreeMap<String, f64> =
        by_kind.into_iter().map(|(kind, (sum, count))| (name(kind).to_owned(), sum / count / CLEAN_LOSS)).collect();
    let losses = losses(tags, residuals, model.judged.len());
    let drives: std::collections::BTreeSet<usize> = losses
        .iter()
        .zip(&model.judged)
        .filter(|(loss, _)| **loss > CLEAN_LOSS)
        .map(|(_, judged)| judged.actor.recording)
        .collect();
    Remainder {
        channels,
        drives: drives.into_iter().collect(),
        time_pattern: "constant".to_owned(),
        text: format!("{:.0} % of the agents move as no driver of the library would", 100.0 * strange),
        ..Remainder::default()
    }
}

/// Applies the frozen corrected model of a diagnosis to recordings, all without numbers, and measures how far the gap
/// shrinks; nothing is fitted.
///
/// # Errors
/// If the case shows nobody for long enough.
pub fn evaluate(diagnosis: &Diagnosis, case: &Case, recordings: &[usize]) -> Result<Vec<Shrink>, TrafficError> {
    let model = Traffic::new(case, &[]);
    let wanted = |recording: usize| recordings.is_empty() || recordings.contains(&recording);
    let chosen: Vec<bool> = model.judged.iter().map(|judged| wanted(judged.actor.recording)).collect();
    if chosen.iter().filter(|chosen| **chosen).count() < 2 {
        return Err(TrafficError::Nobody { case: case.name.clone(), secs: SECS });
    }
    let found = &diagnosis.corrected_model;
    let corrected: Lines = found.mismatch().into_iter().chain(found.added()).collect();
    let alone = if found.effects.is_empty() { corrected.clone() } else { found.mismatch_alone() };
    let [nominal, alone, corrected] = [Lines::new(), alone, corrected].map(|lines| model.space.vector(&lines));
    Ok(how_far(&model, [&nominal, &alone, &corrected], &chosen, "unseen"))
}

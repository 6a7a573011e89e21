//! One case to its diagnosis: search both parts, choose, look at what is left, measure the shrink.

use std::collections::BTreeMap;

use ds_stats::explained;

use crate::baseline::Baseline;
use crate::baseline::nulls::chance;
use crate::bootstrap::weights;
use crate::case::{Case, PartModel};
use crate::cells::{cells, reached};
use crate::choice::{Candidate, Outcome, rank};
use crate::doubts::doubts;
use crate::drive::MEASURED;
use crate::fit::Fit;
use crate::foreign::structure;
use crate::healthy::statistics;
use crate::how_far::{cross_fitted, how_far, position_errors, roots};
use crate::manoeuvre;
use crate::remainder::{PartRemainder, describe, left};
use crate::search::Effort;
use crate::settings::{
    DOUBT, GROUP_COSINE, GROUP_EVIDENCE, LEAST_HELD_OUT, LOOSE_SHAPE, OWN_NUISANCE, SHAPE_ERROR, Thresholds, WEAK,
    WIDTH_SHARE,
};
use crate::shapley::split;
use crate::signature::{cosine, spread};
use crate::space::{Coordinate, Part, SCATTER, Space};
use crate::standing::{Standing, standing};
use crate::windows::BLOCKS;
use ds_diagnosis::Verdict;
use ds_diagnosis::modulation::Modulation;
use ds_diagnosis::schema::{Cell, Corrected, CorrectedEffect, Diagnosis, Finding, Manoeuvre, SCHEMA, Shrink, Unknown};
use ds_diagnosis::score::GROUP_SIZE;
use ds_effect::{Channel, Plant};

/// How to diagnose.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Fast pass and single fits only.
    pub quick: bool,
    /// Effects to leave out of the library, to see what the diagnosis says of effects it does not know.
    pub without: Vec<String>,
}

/// Diagnoses a case.
#[must_use]
pub fn diagnose(case: &Case, options: &Options) -> Diagnosis {
    diagnose_with(case, options, &Thresholds::default())
}

/// Diagnoses a case with other thresholds than the built-in ones.
#[must_use]
pub fn diagnose_with(case: &Case, options: &Options, thresholds: &Thresholds) -> Diagnosis {
    diagnosed(case, options, thresholds).0
}

/// Diagnoses a case and returns as well which explanations of its car it leaves, likeliest first.
#[must_use]
pub fn diagnose_leaving(case: &Case, options: &Options) -> (Diagnosis, Vec<Standing>) {
    diagnosed(case, options, &Thresholds::default())
}

fn diagnosed(case: &Case, options: &Options, thresholds: &Thresholds) -> (Diagnosis, Vec<Standing>) {
    let (fit_drives, held) = case.meta.split();
    let effort = if options.quick { Effort::Quick } else { Effort::Full };
    let models = [Part::Ego, Part::Following].map(|part| PartModel::new(case, part, &fit_drives, &options.without));
    let baseline = case.baseline.as_deref();
    let asked = |part: usize| baseline.map_or(*thresholds, |b| b.thresholds(part, thresholds));
    let run = |(part, model)| Outcome::run(model, &fit_drives, effort, &asked(part));
    let outcomes: Vec<Outcome<'_, '_>> = models.iter().enumerate().map(run).collect();
    let mut ranking = rank(case, &outcomes, thresholds);
    let mute = models.each_ref().map(|model| model.space.mute());
    ranking.retain(|c| !options.without.iter().any(|id| id == c.id) && !mute.iter().any(|of| of.contains(&c.id)));
    let standing = standing(&outcomes[0], &ranking);
    // scattered samples leave more than the shape of an effect does
    let scattered = ranking.iter().any(|c| c.accepted && c.part.is_none());
    let lefts: Vec<PartRemainder> = outcomes
        .iter()
        .map(|o| PartRemainder {
            trend: o.trend,
            ..left(o.model(), &o.judged(), &o.search.null, scattered || o.accepted.is_some())
        })
        .collect();
    let all: Vec<usize> = (0..case.drives.len()).collect();
    let whole = [Part::Ego, Part::Following].map(|part| PartModel::new(case, part, &all, &options.without));
    let p_unknown = match ranking.iter().any(|c| c.accepted) {
        true => unknown(baseline, &lefts, true),
        false => unknown(baseline, &lefts, false).max(in_cells(baseline, &whole, &outcomes)),
    };
    let verdict = verdict(&ranking, p_unknown);
    let doubt = if outcomes.iter().any(|o| o.accepted.is_some()) { DOUBT } else { 0.0 };
    let p_unknown = doubt + (1.0 - doubt - DOUBT) * p_unknown;
    let known = 1.0 - p_unknown;
    let p_none = known * without_any(&mut ranking);
    let effects: Vec<Finding> = ranking.iter().map(|c| finding(case, &outcomes, &ranking, c, known)).collect();
    let chosen: Vec<String> = match verdict {
        Verdict::None => Vec::new(),
        _ => ranking.iter().filter(|c| c.accepted).map(|c| c.id.to_owned()).collect(),
    };
    let data = if held.is_empty() { fit_drives.as_slice() } else { held.as_slice() };
    let unknown_description = (verdict == Verdict::Unknown).then(|| {
        let fits: Vec<_> = outcomes.iter().map(|o| (o.model(), o.fit())).collect();
        describe(case, &lefts, &fits, ranking.iter().take(3).map(|c| c.id.to_owned()).collect())
    });
    let p_structure = (verdict == Verdict::Unknown)
        .then(|| if baseline.is_some() { 1.0 } else { structure(case, &outcomes, &fit_drives, &options.without) });
    let unknown = p_structure.map(|share| Unknown::new(p_unknown, share));
    let diagnosis = Diagnosis {
        schema_version: SCHEMA,
        case: case.meta.case.clone(),
        verdict,
        indistinguishable: groups(&effects),
        p_none,
        p_unknown,
        chosen,
        cells: map(case, &outcomes, &whole),
        how_far: shrinks(case, &outcomes, &fit_drives, &held),
        shares: if options.quick { Vec::new() } else { outcomes.iter().flat_map(|o| split(case, o, data)).collect() },
        attended: Vec::new(),
        predicted_share: predicted(case, &outcomes, &fit_drives),
        unknown_description,
        unknown,
        discovery: None,
        next_manoeuvre: next(case, &outcomes[0], verdict),
        corrected_model: corrected(&outcomes),
        floor_source: floor_source(case).to_owned(),
        warnings: warnings(case, &mute[0]),
        outside_domain_share: baseline.and_then(|baseline| baseline.outside_share(&case.ego)),
        detection_limits: Vec::new(),
        rollouts: None,
        not_testable: mute.concat().into_iter().map(str::to_owned).collect(),
        modulation: modulation(&outcomes),
        secs: 0.0,
        effects,
    };
    (diagnosis, standing)
}

/// Gives every candidate its part of what is kept back for an effect too weak for the data; returns the probability of none.
fn without_any(ranking: &mut [Candidate]) -> f64 {
    let none = (1.0 - ranking.iter().map(|c| c.probability).sum::<f64>()).max(0.0);
    let weak = if ranking.is_empty() { 0.0 } else { WEAK * none };
    let each = weak / ranking.len().max(1) as f64;
    ranking.iter_mut().for_each(|c| c.probability += each);
    none - weak
}

/// Returns the probability that something is at work that no library effect explains.
fn unknown(baseline: Option<&Baseline>, lefts: &[PartRemainder], accepted: bool) -> f64 {
    let p_library = lefts.iter().map(PartRemainder::probability).fold(0.0, f64::max);
    match baseline {
        Some(baseline) if baseline.nulls.len() > 1 => {
            let p_healthy = statistics::unknown(&baseline.nulls, lefts);
            // healthy drives do not know what the uncertain shape of an effect leaves, the library does
            if accepted { p_healthy.min(p_library) } else { p_healthy }
        }
        _ => p_library,
    }
}

/// Returns the probability that something is at work where no effect is accepted, by what single channels leave in some
/// regime: healthy logs say how much is ordinary there.
fn in_cells(baseline: Option<&Baseline>, whole: &[PartModel<'_>], outcomes: &[Outcome<'_, '_>]) -> f64 {
    baseline.filter(|baseline| !baseline.cells.is_empty()).map_or(0.0, |baseline| {
        let fitted: Vec<_> = whole.iter().zip(outcomes).map(|(m, o)| (m, o.fit().vector.as_slice())).collect();
        statistics::probability(chance(&baseline.cells, &reached(&fitted)))
    })
}

/// Returns what is to be known of the case, and which effects its drive command cannot show.
fn warnings(case: &Case, mute: &[&str]) -> Vec<String> {
    let of_baseline = case.baseline.iter().flat_map(|baseline| doubts(baseline, case));
    let of_drive = (!mute.is_empty())
        .then(|| format!("the drive command was computed from the speed; {} cannot be told from it", mute.join(", ")));
    case.warnings.iter().cloned().chain(of_drive).chain(of_baseline).collect()
}

/// Says where the floor comes from.
fn floor_source(case: &Case) -> &'static str {
    match (&case.baseline, case.noise.is_familiar()) {
        (Some(_), _) => "baseline",
        (None, true) => "practice",
        (None, false) => "self",
    }
}

fn verdict(ranking: &[Candidate], p_unknown: f64) -> Verdict {
    if p_unknown > 0.5 {
        return Verdict::Unknown;
    }
    match ranking.iter().filter(|c| c.accepted).count() {
        0 => Verdict::None,
        1 => Verdict::Single,
        _ => Verdict::Multiple,
    }
}

/// Returns the fit that says most about a candidate: the accepted model if it is in there, else its own.
fn fit_of<'a>(outcomes: &'a [Outcome<'_, '_>], candidate: &Candidate) -> Option<&'a Fit> {
    let outcome = &outcomes[candidate.part?];
    match (&outcome.accepted, candidate.accepted) {
        (Some(model), true) => Some(&model.fit),
        _ => outcome.search.singles.get(candidate.single).map(|h| &h.fit),
    }
}

fn finding(
    case: &Case,
    outcomes: &[Outcome<'_, '_>],
    ranking: &[Candidate],
    candidate: &Candidate,
    known: f64,
) -> Finding {
    let mut out = Finding {
        id: candidate.id.to_owned(),
        probability: known * candidate.probability,
        value: 0.0,
        unit: String::new(),
        interval90: [0.0, 0.0],
        group: vec![candidate.id.to_owned()],
        heldout_gain: candidate.held_out,
        evidence_gain: candidate.gain,
        params: BTreeMap::new(),
    };
    let (Some(part), Some(fit)) = (candidate.part, fit_of(outcomes, candidate)) else {
        return scatter_finding(case, out);
    };
    let model = outcomes[part].search.model;
    let Some(effect) = model.space.find(candidate.id) else { return out };
    for (place, k) in model.space.of(effect).into_iter().enumerate() {
        let Coordinate { parameter, nuisance, .. } = model.space.coordinates[k];
        // what every vehicle has is no part of the effect; a slab that starts beyond neutral is an absolute value
        let usual = match nuisance {
            Some(n) if parameter.slab.0 <= parameter.neutral => n.mean - parameter.neutral,
            _ => 0.0,
        };
        let own = nuisance.map_or(0.0, |n| OWN_NUISANCE * n.sd);
        let centre = fit.vector[k] - usual;
        let share = if candidate.id == LOOSE_SHAPE.0 { LOOSE_SHAPE.1 } else { SHAPE_ERROR };
        let shape = if parameter.neutral.is_finite() { share * (centre - parameter.neutral) } else { share };
        let width = WIDTH_SHARE * 1.645 * spread(model, fit, k).hypot(own).hypot(shape);
        let reported = |v: f64| model.space.reported(k, v);
        out.params.insert(parameter.name.to_owned(), reported(centre));
        if place == 0 {
            out.value = reported(centre);
            out.unit = parameter.unit.to_owned();
            out.interval90 = [reported(centre - width), reported(centre + width)];
        }
    }
    out.group = group(outcomes, ranking, candidate, fit);
    out
}

fn scatter_finding(case: &Case, mut out: Finding) -> Finding {
    let scatter = &case.scatter;
    let usual = case.baseline.as_ref().map(|baseline| baseline.sampling).unwrap_or_default();
    let jitter = out.id == SCATTER[0];
    let beyond = |value: f64| if jitter { usual.jitter_beyond(value) } else { usual.repeats_beyond(value) };
    let (value, error) = if jitter {
        (scatter.jitter_secs, scatter.jitter_error_secs)
    } else {
        (scatter.repeated_share, scatter.repeated_error)
    };
    out.value = beyond(value);
    out.unit = if jitter { "s" } else { "1" }.to_owned();
    out.interval90 = [beyond(value - 1.645 * error), beyond(value + 1.645 * error)];
    out
}

/// Returns the effects that these data cannot tell from a candidate, best first, itself in front.
fn group(outcomes: &[Outcome<'_, '_>], ranking: &[Candidate], candidate: &Candidate, fit: &Fit) -> Vec<String> {
    let mut members = vec![candidate.id.to_owned()];
    let Some(part) = candidate.part else { return members };
    let model = outcomes[part].search.model;
    let Some(own) = model.space.find(candidate.id).map(|e| model.space.of(e)[0]) else { return members };
    let mut rivals: Vec<(&str, f64)> = Vec::new();
    for other in ranking.iter().filter(|c| c.part == Some(part) && c.id != candidate.id && !c.accepted) {
        let Some(k) = model.space.find(other.id).map(|e| model.space.of(e)[0]) else { continue };
        let alike = cosine(model, fit, own, k).is_some_and(|c| c.abs() > GROUP_COSINE);
        let close = candidate.gain > GROUP_EVIDENCE && (candidate.gain - other.gain).abs() < GROUP_EVIDENCE;
        if (alike && other.gain > 0.5 * candidate.gain) || close {
            rivals.push((other.id, other.gain));
        }
    }
    rivals.sort_by(|a, b| b.1.total_cmp(&a.1));
    members.extend(rivals.iter().take(GROUP_SIZE - 1).map(|r| r.0.to_owned()));
    members
}

fn groups(effects: &[Finding]) -> Vec<Vec<String>> {
    let mut sets: Vec<Vec<String>> = Vec::new();
    for effect in effects.iter().filter(|e| e.group.len() > 1 && e.probability > 0.02) {
        let mut set = effect.group.clone();
        set.sort();
        if !sets.contains(&set) {
            sets.push(set);
        }
    }
    sets
}

/// Maps the gap over all drives: fitted nuisances, accepted effects taken out.
fn map(case: &Case, outcomes: &[Outcome<'_, '_>], whole: &[PartModel<'_>]) -> Vec<Cell> {
    let mut found = Vec::new();
    for (outcome, model) in outcomes.iter().zip(whole) {
        let after = &outcome.fit().vector;
        let mut before = after.clone();
        if let Some(accepted) = &outcome.accepted {
            let usual = model.space.usual();
            for k in accepted.effects.iter().flat_map(|e| model.space.of(*e)) {
                before[k] = usual[k];
            }
        }
        found.extend(cells(case, model, &before, after));
    }
    found.sort_by(|a, b| b.effect_size.total_cmp(&a.effect_size));
    found.truncate(400);
    found
}

/// Measures how far the gap shrinks on the drives kept from the fit; on all of them, each by a fit without it, where too
/// little was kept.
fn shrinks(case: &Case, outcomes: &[Outcome<'_, '_>], fitted: &[usize], held: &[usize]) -> Vec<Shrink> {
    let plants = [0, 1].map(|k| {
        let outcome: &Outcome<'_, '_> = &outcomes[k];
        outcome.vectors().map(|vector| outcome.search.model.space.plant(&vector))
    });
    let states = [&plants[0].each_ref(), &plants[1].each_ref()];
    let kept: usize = held.iter().map(|&d| case.drives[d].samples).sum();
    let mut found = if kept < LEAST_HELD_OUT { Vec::new() } else { how_far(case, held, states, "heldout") };
    if found.is_empty() && case.drives.len() > 1 {
        found = cross_fitted(case, &crossed(case, outcomes, fitted));
    }
    if found.is_empty() {
        found = how_far(case, if held.is_empty() { fitted } else { held }, states, "fit");
    }
    found
}

/// Returns the simulators of both parts for every drive, fitted without it.
fn crossed(case: &Case, outcomes: &[Outcome<'_, '_>], fitted: &[usize]) -> Vec<(usize, [[Plant; 3]; 2])> {
    let of = |drive: usize| {
        let plants = |part: usize| {
            let outcome = &outcomes[part];
            let apart = fitted.len() > 1 && fitted.contains(&drive);
            let vectors = if apart { outcome.without_drive(drive) } else { outcome.vectors() };
            vectors.map(|vector| outcome.search.model.space.plant(&vector))
        };
        (drive, [0, 1].map(plants))
    };
    (0..case.drives.len()).map(of).collect()
}

/// Returns the share of `position_2s` that the effects explain on the fit drives, each by fits made without it.
fn predicted(case: &Case, outcomes: &[Outcome<'_, '_>], drives: &[usize]) -> Option<f64> {
    let (mut rows, mut owners) = (Vec::new(), Vec::new());
    let car = &outcomes[0];
    for &drive in drives {
        let vectors = if drives.len() > 1 { car.without_drive(drive) } else { car.vectors() };
        let plants = vectors.map(|vector| car.search.model.space.plant(&vector));
        let (errors, of) = position_errors(case, &[drive], &plants.each_ref());
        rows.extend(errors);
        owners.extend(of);
    }
    let states = |draw: Option<&Vec<f64>>| {
        let [_, nuisance, corrected, floor] = roots(&rows, draw);
        [nuisance, corrected, floor]
    };
    let drawn: Vec<[f64; 3]> = weights(&owners, "predicted").iter().map(|draw| states(Some(draw))).collect();
    explained(states(None), &drawn).map(|found| found.share)
}

/// Ranks manoeuvres that separate the two best effects of the car beside the ordinary mismatch of the first, by the sensors
/// of the case; none where nothing is found.
fn next(case: &Case, outcome: &Outcome<'_, '_>, verdict: Verdict) -> Vec<Manoeuvre> {
    let space = &outcome.search.model.space;
    let ([first, second, ..], false) = (outcome.search.singles.as_slice(), verdict == Verdict::None) else {
        return Vec::new();
    };
    let mut rival = first.fit.vector.clone();
    let usual = space.usual();
    space.of(first.effects[0]).into_iter().for_each(|k| rival[k] = usual[k]);
    space.of(second.effects[0]).into_iter().for_each(|k| rival[k] = second.fit.vector[k]);
    let present: Vec<&str> = case.drives[0].columns().iter().map(|c| c.0).collect();
    let sensor = |channel: usize| {
        let healthy = case.baseline.as_ref().map_or(1.0, |b| b.factor(Channel::ALL[channel], BLOCKS - 1));
        if present.contains(&MEASURED[channel]) { healthy * case.noise.ego[channel] } else { f64::INFINITY }
    };
    let names = [first, second].map(|h| space.effects[h.effects[0]].id);
    manoeuvre::rank(names, [&space.plant(&first.fit.vector), &space.plant(&rival)], &std::array::from_fn(sensor))
}

/// Returns when the accepted effect acts that is furthest from constant.
fn modulation(outcomes: &[Outcome<'_, '_>]) -> Option<Modulation> {
    let timings = outcomes.iter().filter_map(|o| o.timing.as_ref().map(|timing| (o, timing)));
    let (outcome, timing) = timings.max_by(|a, b| a.1.gain.total_cmp(&b.1.gain))?;
    let space = &outcome.search.model.space;
    let k = space.of(timing.effect)[0];
    let (neutral, usual) = (space.coordinates[k].parameter.neutral, space.usual()[k]);
    let value = neutral + timing.size * (outcome.fit().vector[k] - usual);
    let [secs, from, to] = timing.instant;
    let told = timing.is_telling();
    Some(Modulation {
        effect: space.effects[timing.effect].id.to_owned(),
        kind: timing.pattern.kind.to_owned(),
        evidence: if told { timing.gain } else { -timing.gain },
        onset_s: told.then_some(secs),
        interval90: told.then_some([from, to]),
        drive: told.then_some(timing.pattern.drive),
        scope: told.then(|| timing.pattern.scope.word().to_owned()),
        value: (told && value.is_finite()).then(|| space.reported(k, value)),
        sessions: timing.sessions.clone(),
    })
}

fn corrected(outcomes: &[Outcome<'_, '_>]) -> Corrected {
    let mut out = Corrected::default();
    let any = outcomes.iter().any(|outcome| outcome.accepted.is_some());
    for outcome in outcomes {
        let space = &outcome.search.model.space;
        let [_, null, vector] = outcome.vectors();
        let accepted = outcome.accepted.as_ref().map(|h| h.effects.clone()).unwrap_or_default();
        for (effect, e) in space.effects.iter().enumerate() {
            if accepted.contains(&effect) {
                let values: Vec<f64> = space.of(effect).iter().map(|&k| space.reported(k, vector[k])).collect();
                out.effects.push(CorrectedEffect { id: e.id.to_owned(), value: values[0], values });
            } else {
                out.nuisance.extend(named(space, effect, &vector));
            }
            if any {
                out.ordinary.extend(named(space, effect, &null));
            }
        }
    }
    out
}

/// Returns the parameters of an effect that are not neutral, by name and in reported units.
#[must_use]
pub fn named(space: &Space, effect: usize, vector: &[f64]) -> Vec<(String, f64)> {
    let id = space.effects[effect].id;
    let of = |(place, k): (usize, usize)| {
        let key = if place == 0 { id.to_owned() } else { format!("{id}.{}", place + 1) };
        let moved = vector[k].is_finite() && vector[k] != space.coordinates[k].parameter.neutral;
        moved.then(|| (key, space.reported(k, vector[k])))
    };
    space.of(effect).into_iter().enumerate().filter_map(of).collect()
}

//! From a case folder to a diagnosis: search, verdict, probabilities, places, and how far the gap shrinks.

use ds_diagnosis::Verdict;
use ds_diagnosis::meta::Pairing;
use ds_diagnosis::schema::{Corrected, CorrectedEffect, Diagnosis, Finding};

use crate::case::FrameCase;
use crate::error::FramesError;
use crate::grain;
use crate::how_far::{Correction, how_far, image_share};
use crate::pairing::nuisance::Nuisance;
use crate::pairing::{estimated, verdict};
use crate::scene::Scene;
use crate::search::{Ready, Round, Search, Trial, search};
use crate::{alike, fringe, heldout, interval, places, remainder, settings};

/// What to do.
#[derive(Debug, Clone, Default)]
pub struct Options {
    /// Effects that are left out of the library, to see what is said without them.
    pub without: Vec<String>,
    /// What the generator does without any effect, for streams that do not agree pixel by pixel.
    pub nuisance: Option<Nuisance>,
}

/// Diagnoses a case of two frame streams.
///
/// # Errors
/// If the effect-free pairs that the case names cannot be read, or there is no distance between its frames.
pub fn diagnose(case: &FrameCase, options: &Options) -> Result<Diagnosis, FramesError> {
    let scene = Scene::new(case);
    let mut ready = None;
    let pairing = case.pairing.unwrap_or_else(|| {
        let measured = Ready::of(&scene);
        let pairing = estimated(&scene, &measured.field, &measured.late.ages);
        ready = Some(measured);
        pairing
    });
    if pairing == Pairing::Aligned {
        aligned(case, &scene, ready.unwrap_or_else(|| Ready::of(&scene)), options)
    } else {
        let learned = match (&options.nuisance, &case.nuisance) {
            (Some(known), _) => known.clone(),
            (None, Some(folder)) => Nuisance::learn(folder)?,
            (None, None) => Nuisance::assumed(),
        };
        verdict::judged(&scene, pairing, &learned, &options.without)
    }
}

fn aligned(case: &FrameCase, scene: &Scene<'_>, ready: Ready, options: &Options) -> Result<Diagnosis, FramesError> {
    let found = search(scene, ready, &options.without);
    let texture = grain::texture(scene, &scene.full_of(&found.model, &found.placed.full));
    let excess = remainder::excess(&found, &texture, fringe::apart(scene, &found.model));
    let remains = places::remains(&found.loss);
    let noise = remains.iter().sum::<f64>() / remains.len() as f64;
    let correction = Correction {
        effects: found.model.effects.clone(),
        shift: mean_shift(&found),
        noise,
        dirt: found.model.dirt.clone(),
    };
    let held = how_far(case, &correction, &|n| case.held.iter().any(|f| f.number == n), "heldout")?;
    let verdict = match found.chosen.len() {
        _ if excess > 1.0 => Verdict::Unknown,
        0 => Verdict::None,
        1 => Verdict::Single,
        _ => Verdict::Multiple,
    };
    let p_unknown = 1.0 / (1.0 + (-(excess.max(1e-6).ln()) / settings::UNKNOWN_WIDTH).exp());
    let p_none = (1.0 - p_unknown) * none_share(&found);
    let effects = findings(scene, &found, 1.0 - p_unknown - p_none);
    let cells = if verdict == Verdict::None {
        Vec::new()
    } else {
        places::cells(scene, &places::differences(scene, &found.model, &remains))
    };
    Ok(Diagnosis {
        verdict,
        indistinguishable: ds_diagnosis::schema::group_of_first(&effects),
        effects,
        p_none,
        p_unknown,
        chosen: found.chosen.iter().map(|id| (*id).to_owned()).collect(),
        cells,
        how_far: held,
        predicted_share: image_share(case, &correction, &|n| case.fit.iter().any(|f| f.number == n)),
        unknown_description: (verdict == Verdict::Unknown).then(|| remainder::describe(&found, &texture)),
        next_manoeuvre: crate::next::manoeuvres(scene, &found),
        corrected_model: corrected(&correction),
        warnings: case.warnings.clone(),
        ..Diagnosis::blank(&case.name)
    })
}

fn mean_shift(found: &Search) -> [f64; 2] {
    let n = found.model.shifts.len() as f64;
    [0, 1].map(|d| found.model.shifts.iter().map(|s| s[d]).sum::<f64>() / n)
}

/// Returns the share of none among what the library can say.
fn none_share(found: &Search) -> f64 {
    if !found.chosen.is_empty() {
        let first = &found.rounds[0];
        let gain = first.gain(&first.trials[0]);
        return 1.0 / (1.0 + ((gain - settings::FIRST_GAIN) / settings::TEMPERATURE).exp());
    }
    let weights: f64 = found.rounds.first().map_or(0.0, |r| r.trials.iter().map(|t| weight(r, t)).sum());
    1.0 / (1.0 + weights)
}

fn weight(round: &Round, trial: &Trial) -> f64 {
    ((round.gain(trial) - settings::FIRST_GAIN) / settings::TEMPERATURE).clamp(-30.0, 30.0).exp()
}

/// Lists chosen effects first, then the other trials of the first round; together they have the given probability.
fn findings(scene: &Scene<'_>, found: &Search, mass: f64) -> Vec<Finding> {
    let mut list: Vec<(Finding, f64)> = Vec::new();
    let held = heldout::gains(found, scene);
    let rounds = found.chosen.len().max(1);
    for (k, round) in found.rounds.iter().take(rounds).enumerate() {
        let top = round.trials.first().map_or(0.0, |t| round.gain(t));
        let total: f64 = round.trials.iter().map(|t| ((round.gain(t) - top) / settings::TEMPERATURE).exp()).sum();
        for trial in &round.trials {
            let share = ((round.gain(trial) - top) / settings::TEMPERATURE).exp() / total / rounds as f64;
            if let Some((_, sum)) = list.iter_mut().find(|(f, _)| f.id == trial.id) {
                *sum += share;
            } else if k == 0 || found.chosen.contains(&trial.id) {
                let mut finding = finding(scene, found, round, trial);
                finding.heldout_gain = held.get(trial.id).copied();
                list.push((finding, share));
            }
        }
    }
    let total: f64 = list.iter().map(|(_, s)| s).sum();
    for (finding, share) in &mut list {
        finding.probability = mass.max(0.0) * *share / total.max(1e-12);
    }
    let place = |f: &Finding| found.chosen.iter().position(|id| *id == f.id).unwrap_or(usize::MAX);
    list.sort_by(|(a, _), (b, _)| place(a).cmp(&place(b)).then(b.evidence_gain.total_cmp(&a.evidence_gain)));
    list.into_iter().map(|(f, _)| f).collect()
}

fn finding(scene: &Scene<'_>, found: &Search, round: &Round, trial: &Trial) -> Finding {
    let chosen = found.chosen.contains(&trial.id);
    let model = if chosen { &found.model } else { &trial.model };
    let effect = crate::scene::known(trial.id);
    let values = model.values(trial.id).map_or_else(|| effect.neutral(), <[f64]>::to_vec);
    let gain = round.gain(trial);
    let group = if chosen || round.trials.first().is_some_and(|t| t.id == trial.id) {
        alike::group(scene, found, round, trial)
    } else {
        vec![trial.id.to_owned()]
    };
    Finding {
        id: trial.id.to_owned(),
        probability: 0.0,
        value: values[0],
        unit: effect.parameters[0].unit.to_owned(),
        interval90: interval::of(scene, found, effect, &values),
        group,
        heldout_gain: None,
        evidence_gain: gain,
        params: effect.parameters.iter().zip(&values).map(|(p, v)| (p.name.to_owned(), *v)).collect(),
    }
}

fn corrected(correction: &Correction) -> Corrected {
    let effects = correction.effects.iter().map(|(effect, values)| {
        let mut values = values.clone();
        if let (Some(map), "lens_dirt") = (&correction.dirt, effect.id) {
            values.truncate(effect.parameters.len());
            values.extend(map.listed());
        }
        CorrectedEffect { id: effect.id.to_owned(), value: values[0], values }
    });
    let nuisance =
        [("shift_x_px", correction.shift[0]), ("shift_y_px", correction.shift[1]), ("noise_levels2", correction.noise)];
    let nuisance = nuisance.into_iter().map(|(k, v)| (k.to_owned(), v)).collect();
    Corrected { effects: effects.collect(), nuisance, ..Corrected::default() }
}

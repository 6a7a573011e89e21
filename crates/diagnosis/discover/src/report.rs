//! The whole way: search every port, refine the best, weigh ports against each other and against the library, report.

use std::collections::BTreeSet;

use ds_diagnosis::Verdict;
use ds_diagnosis::discovery::{Discovery, FoundLaw, FoundTerm, LawKind, LawShare, Place};
use ds_diagnosis::schema::{Corrected, Diagnosis, Shrink};
use ds_dynamics::case::{Case, PartModel};
use ds_dynamics::fit::data_loss;
use ds_dynamics::motion::takes;
use ds_dynamics::space::Part;
use ds_effect::{Channel, Effect, Insertion, Law, Port};
use ds_stats::log_sum;

use crate::beyond::extrapolated_share;
use crate::free;
use crate::law::Refined;
use crate::port::{Base, Searched};
use crate::settings::{
    ASKED_GAIN, EQUIVALENT, FREE_SHARE, LAW_GAIN, LEAST_OF_FREE, LEAST_SHARE, OF_ITSELF, OVER_LIBRARY, OVER_SUMS,
    REFINED, STABLE, TELLING_SHARE, TEMPERATURE,
};
use crate::shrink::{corrected, is_of_followers, of_port, shrinks};
use crate::tables::{self, Best};
use crate::terms::ports;

/// What may act at one port.
struct Offer {
    port: Port,
    /// Place of the part's base.
    part: usize,
    /// The best law, where one is worth a fit.
    law: Option<Tried>,
    /// Log evidence of a signal there that depends on nothing recorded.
    free: f64,
    /// Log sum of the tempered evidences of the laws that were tried there.
    weight: f64,
}

/// A law fitted to the simulator itself.
struct Tried {
    refined: Refined,
    /// Predictive log score by drive left out.
    held_out: Vec<f64>,
    /// By term, the share of refits without one drive that keep it.
    stable: Vec<f64>,
}

/// Searches a case for a law and says so in its diagnosis; `without` are effects that this left out. A law that holds takes the
/// place of effects in the corrected simulator, and how far the gap shrinks is measured with it.
pub fn discover(case: &Case, diagnosis: &mut Diagnosis, without: &[String]) {
    let (found, corrected) = search(case, diagnosis, without);
    diagnosis.discovery = Some(found);
    if let Some((model, shrinks)) = corrected {
        diagnosis.corrected_model = model;
        diagnosis.how_far = shrinks;
    }
}

/// The corrected simulator, and how far it shrinks the gap.
type Correction = (Corrected, Vec<Shrink>);

fn search(case: &Case, diagnosis: &Diagnosis, without: &[String]) -> (Discovery, Option<Correction>) {
    let (drives, held) = case.meta.split();
    let models = [Part::Ego, Part::Following].map(|part| (part, PartModel::new(case, part, &drives, without)));
    let bases: Vec<(Part, Base<'_, '_>)> =
        models.iter().filter(|(_, model)| !model.is_empty()).map(|(part, model)| (*part, Base::new(model))).collect();
    let mut offers: Vec<Offer> =
        bases.iter().enumerate().flat_map(|(k, (part, base))| offers_of(base, k, *part)).collect();
    offers.sort_by(|a, b| b.weight.total_cmp(&a.weight));
    let insertion = places(&offers, diagnosis);
    let p_none = 1.0 - insertion.iter().map(|place| place.probability).sum::<f64>();
    let here = |offer: &&Offer| insertion.first().is_none_or(|place| place.id == offer.port.insertion());
    let best = offers.iter().find(here).or(offers.first());
    let mut found = Discovery { insertion: insertion.clone(), p_none, ..Discovery::default() };
    let Some(best) = best else { return (found, None) };
    if let Some(tried) = &best.law {
        found.evidence_gain = tried.refined.gain;
        found.heldout_gain = Some(tried.held_out.iter().sum());
    }
    let tried = match offered(best, diagnosis) {
        Ok(tried) => tried,
        Err(why) => {
            found.note = Some(why);
            return (found, None);
        }
    };
    let (part, base) = &bases[best.part];
    let data = if held.is_empty() { (drives.as_slice(), "fit") } else { (held.as_slice(), "heldout") };
    let is_open = takes(case.stand_in.as_ref(), best.port);
    let all = is_open.then(|| shrinks(case, *part, base, &tried.refined, data.0, data.1));
    let told = |all: &Vec<Shrink>| all.iter().any(|s| is_of_followers(s) == (best.port == Port::Follower));
    let Some(all) = all.filter(|all| case.stand_in.is_none() || told(all)) else {
        found.kept_gain = (!held.is_empty()).then(|| gain_on(case, *part, base, &tried.refined, &held, without));
        if let Some(gain) = found.kept_gain.filter(|gain| *gain < 0.0) {
            found.note = Some(format!("the best law does not hold on drives kept from its fit (log score {gain:.1})"));
            return (found, None);
        }
        found.law = law(tried, &offers);
        found.extrapolated_share = tried.refined.law().and_then(|law| extrapolated_share(case, &law, data.0));
        let why = match is_open {
            true => "all that this simulator may be asked was asked before".to_owned(),
            false => format!("this simulator has no port at {}", best.port.insertion()),
        };
        found.note = Some(format!("{why}: {BUILT_IN}"));
        return (found, None);
    };
    let share = of_port(best.port, &all).and_then(|shrink| shrink.share_explained.map(|share| (shrink, share)));
    if let Some((shrink, share)) = share
        && share < LEAST_SHARE
    {
        let law = tried.refined.law().map(|law| law.to_string()).unwrap_or_default();
        let note = format!("the best law ({law}) closes nothing of the gap in {} ({share:.2} of it)", shrink.metric);
        found.note = Some(note);
        return (found, None);
    }
    found.law = law(tried, &offers);
    found.share_explained = share.map(|(shrink, value)| LawShare {
        metric: shrink.metric.clone(),
        value,
        interval90: shrink.interval90,
        on: shrink.data.clone(),
    });
    found.extrapolated_share = tried.refined.law().and_then(|law| extrapolated_share(case, &law, data.0));
    let model = corrected(&diagnosis.corrected_model, base, &tried.refined);
    (found, Some((model, all)))
}

/// Said of a law that a simulator of somebody else cannot be given.
const BUILT_IN: &str = "what it would do with the law is taken from the built-in car, how far the law closes the gap is not measured, and \
     the corrected simulator is without it";

/// Returns the log score that a law gains on some drives over the nuisances alone, with nothing fitted there.
fn gain_on(case: &Case, part: Part, base: &Base<'_, '_>, found: &Refined, drives: &[usize], without: &[String]) -> f64 {
    let model = PartModel::new(case, part, drives, without);
    let laws: Vec<_> = found.law().into_iter().collect();
    let loss = |vector: &[f64], laws: &[Law]| data_loss(&model.residuals_under(vector, laws));
    loss(&base.null.vector, &[]) - loss(found.nuisances(), &laws)
}

/// Returns the law to offer, or why none is.
fn offered<'o>(best: &'o Offer, diagnosis: &Diagnosis) -> Result<&'o Tried, String> {
    let library = diagnosis.effects.iter().map(|e| e.evidence_gain).fold(0.0, f64::max);
    let gain = best.law.as_ref().map_or(0.0, |tried| tried.refined.gain);
    if diagnosis.verdict == Verdict::None && gain < ASKED_GAIN {
        return Err(format!(
            "nothing lies beyond what every vehicle has, and the best law says too little (log evidence {gain:.1}, {ASKED_GAIN:.0} are asked for)"
        ));
    }
    if diagnosis.verdict != Verdict::Unknown && gain < library + OVER_LIBRARY {
        return Err(format!(
            "effects of the library explain as much as any law (log evidence {library:.1} against {gain:.1})"
        ));
    }
    let tried = best.law.as_ref().filter(|_| gain >= LAW_GAIN.max(LEAST_OF_FREE * best.free));
    let Some(tried) = tried else {
        return Err(match best.free > LAW_GAIN {
            true => format!(
                "something acts at {} that no law of the grammar tells: a free signal there has log evidence {:.1}, the best law {gain:.1}",
                best.port.insertion(),
                best.free
            ),
            false => format!("no law of the grammar explains what remains (log evidence {gain:.1})"),
        });
    };
    if !holds(&tried.held_out) {
        let sum: f64 = tried.held_out.iter().sum();
        return Err(format!("the best law does not hold on drives left out of its fit (log score {sum:.1})"));
    }
    Ok(tried)
}

/// Tells whether gains on drives left out speak for a law: by more than a standard error from four drives on.
fn holds(gains: &[f64]) -> bool {
    let n = gains.len() as f64;
    let sum: f64 = gains.iter().sum();
    let variance = gains.iter().map(|g| (g - sum / n).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    gains.len() < 2 || sum > if gains.len() < 4 { 0.0 } else { (n * variance).sqrt() }
}

/// Searches every port of a part and fits the best laws to the simulator itself.
fn offers_of(base: &Base<'_, '_>, place: usize, part: Part) -> Vec<Offer> {
    let searched: Vec<Searched<'_>> = ports(part).into_iter().filter_map(|port| base.search(port)).collect();
    let laws: Vec<f64> = searched.iter().map(|s| s.sets[0].gain).collect();
    let frees: Vec<f64> = searched.iter().map(|s| free::gain(base, s.port, &s.rows, &s.empty)).collect();
    let first = |gains: &[f64]| {
        let mut order: Vec<usize> = (0..gains.len()).collect();
        order.sort_by(|a, b| gains[*b].total_cmp(&gains[*a]));
        order.into_iter().take(REFINED)
    };
    let near: Vec<usize> = first(&laws).chain(first(&frees)).collect();
    let offer = |(k, s): (usize, &Searched<'_>)| {
        let sum = (near.contains(&k) && s.sets[0].gain > 0.0).then(|| tried(base, s));
        let gain = sum.as_ref().map_or(0.0, |tried| tried.refined.gain);
        let shift = if sum.is_some() { gain - s.sets[0].gain } else { 0.0 };
        let table = near.contains(&k).then(|| tabled(base, s)).flatten();
        let table = table.filter(|table| table.refined.gain > gain.max(0.0) + OVER_SUMS);
        let by_table = table.as_ref().map(|table| table.refined.gain / TEMPERATURE);
        let weight = log_sum(s.sets.iter().map(|set| (set.gain + shift) / TEMPERATURE).chain(by_table));
        Offer { port: s.port, part: place, law: table.or(sum), free: frees[k], weight }
    };
    searched.iter().enumerate().map(offer).collect()
}

fn tried(base: &Base<'_, '_>, searched: &Searched<'_>) -> Tried {
    let best = &searched.sets[0];
    let (terms, start) = searched.law(best);
    // what the choice among sets costs is in the linear gain, not in the evidence of a fit
    let cost = cost(searched.candidates.len(), terms.len());
    let refined = Refined::new(base, searched.port, terms, &start, cost).stretched(base, cost);
    Tried { refined, held_out: searched.rows.held_out(best, &searched.empty), stable: searched.rows.stability(best) }
}

/// Returns the best table of a port, fitted to the simulator itself.
fn tabled(base: &Base<'_, '_>, sums: &Searched<'_>) -> Option<Tried> {
    let Best { searched, mixing, of } = tables::best(base, sums)?;
    let best = &searched.sets[0];
    let (terms, start) = searched.law(best);
    let refined = Refined::mixed(base, searched.port, (terms, mixing), &start, -(of as f64).ln());
    let held_out = searched.rows.held_out(best, &searched.empty);
    Some(Tried { refined, held_out, stable: vec![tables::stability(&searched)] })
}

/// Log prior of a set of terms among those of a port.
fn cost(of: usize, terms: usize) -> f64 {
    -(0..terms).map(|k| ((of - k) as f64 / (k + 1) as f64).ln()).sum::<f64>() - 0.7 * terms as f64
}

/// What the drives can tell apart whatever it is: the ports that turn the car, that which drives it, each sensor, followers.
fn family(insertion: &str) -> &str {
    if insertion.starts_with("lateral") { "steering" } else { insertion }
}

/// Weighs the points of the loop against each other, with the library's effects as further laws of theirs, and against nothing.
///
/// A free signal tells families apart but not the points of one: within a family laws decide where they explain enough,
/// else the free signals do.
fn places(offers: &[Offer], diagnosis: &Diagnosis) -> Vec<Place> {
    let mut laws: Vec<(String, f64)> = offers.iter().map(|offer| (offer.port.insertion(), offer.weight)).collect();
    let unknown = diagnosis.verdict == Verdict::Unknown;
    for finding in &diagnosis.effects {
        let Some(port) = ds_effect::find(&finding.id).and_then(port_of) else { continue };
        // what was accepted and yet leaves something unknown is one law among others
        let gain = finding.evidence_gain - if unknown { LAW_GAIN } else { 0.0 };
        laws.push((port, gain / TEMPERATURE));
    }
    let frees: Vec<(String, f64)> = offers.iter().map(|offer| (offer.port.insertion(), free_weight(offer))).collect();
    let sum = |all: &[(String, f64)], of: &dyn Fn(&str) -> bool| {
        log_sum(all.iter().filter(|(id, _)| of(id)).map(|(_, weight)| *weight))
    };
    // one port among all
    let dilution = (Port::all().len() as f64).ln();
    let mut logs: Vec<(&str, f64)> = Vec::new();
    let ids: BTreeSet<&str> = laws.iter().map(|(id, _)| id.as_str()).collect();
    for id in ids {
        let kin = |other: &str| family(other) == family(id);
        let (by_law, by_free) = (sum(&laws, &kin), sum(&frees, &kin));
        let telling = by_law > (LAW_GAIN / TEMPERATURE).max(TELLING_SHARE * by_free);
        let decides = if telling || by_free == f64::NEG_INFINITY { &laws } else { &frees };
        let share = sum(decides, &|other| other == id) - sum(decides, &kin);
        logs.push((id, share + log_sum([by_law, by_free]) - dilution));
    }
    let total = log_sum(logs.iter().map(|log| log.1).chain([0.0]));
    let place = |(id, log): (&str, f64)| Place { id: id.to_owned(), probability: (log - total).exp() };
    let mut places: Vec<Place> = logs.into_iter().map(place).collect();
    places.retain(|place| place.probability > 1e-4);
    places.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    places
}

/// What a free signal at a port weighs beside laws: it explains these drives and predicts no other. What turns the car and
/// depends on nothing recorded pushes it rather than its wheels.
fn free_weight(offer: &Offer) -> f64 {
    let steers = matches!(offer.port, Port::Steering | Port::Linkage);
    FREE_SHARE * offer.free / TEMPERATURE * if steers { OF_ITSELF } else { 1.0 }
}

/// Returns the point of the loop at which an effect of the library acts, as laws name it.
fn port_of(effect: &'static Effect) -> Option<String> {
    let steers = effect.id.starts_with("steer") || effect.id == "servo_order";
    let sensor = |channel: Channel| Some(Port::Sensor(channel).insertion());
    match (effect.insertion, effect.id) {
        (Insertion::CommandPath, "cmd_hold_rate") => Some(Port::Steering.insertion()),
        (Insertion::CommandPath | Insertion::Actuator, _) => {
            Some(if steers { Port::Steering } else { Port::Drive }.insertion())
        }
        (Insertion::Vehicle, "front_grip" | "tyre_relaxation" | "mu") => Some(Port::Front.insertion()),
        (Insertion::Vehicle, "rear_grip") => Some(Port::Rear.insertion()),
        (Insertion::Vehicle, "payload" | "drag_add" | "roll_add") | (Insertion::Road, "grade") => {
            Some(Port::Drive.insertion())
        }
        (Insertion::Vehicle | Insertion::Road, _) => Some(Port::Yaw.insertion()),
        (Insertion::Sensor, "lever_arm") => None,
        (Insertion::Sensor | Insertion::Clock, _) => sensor(*effect.channels.first()?),
        (Insertion::Agent, _) => Some(Port::Follower.insertion()),
        _ => None,
    }
}

fn law(tried: &Tried, offers: &[Offer]) -> Option<FoundLaw> {
    let refined = &tried.refined;
    let law = refined.law()?;
    let errors = refined.errors();
    let terms = law.terms().iter().zip(&refined.terms).zip(&errors).map(|((term, candidate), error)| {
        let half = 1.645 * error * candidate.scale;
        FoundTerm {
            expression: term.expression.bare(),
            coefficient: term.coefficient,
            interval90: [term.coefficient - half, term.coefficient + half],
        }
    });
    let other = |offer: &Offer| offer.law.as_ref().map(|t| &t.refined).filter(|r| r.port != refined.port).cloned();
    let close = offers.iter().filter_map(other).filter(|r| refined.gain - r.gain < EQUIVALENT);
    Some(FoundLaw {
        text: law.to_string(),
        terms: terms.collect(),
        kind: if law.terms().iter().any(|term| term.expression.knot_of().is_some()) {
            LawKind::Table
        } else {
            LawKind::Expression
        },
        equivalent: close.filter_map(|r| r.law()).map(|l| l.to_string()).collect(),
        port: refined.port.name(),
        unit: refined.port.unit().to_owned(),
        stable: tried.stable.iter().all(|share| *share >= STABLE),
    })
}

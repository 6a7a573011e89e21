//! What a diagnosis says in one sentence, and the top of the page that says it.

use ds_diagnosis::Verdict;
use ds_diagnosis::schema::{Diagnosis, Finding, Shrink, Unknown};
use ds_effect::Channel;

use super::law;
use super::markup::Markup;
use super::value;
use super::words;

/// Before over floor from which the metric of `predicted_share` is the one to tell.
const TELLING: f64 = 1.5;

/// Returns the metric that says most about the shrink: the one of `predicted_share` where the chosen effects move the
/// vehicle or the image, else the one that the gap lifts furthest beyond its floor among the channels they show in.
pub(crate) fn telling(diagnosis: &Diagnosis) -> Option<&Shrink> {
    let ratio = |s: &Shrink| if s.floor > 0.0 && s.before.is_finite() { s.before / s.floor } else { 0.0 };
    let known: Vec<_> = diagnosis.chosen.iter().filter_map(|id| ds_effect::find(id)).collect();
    let shows = |channel: Channel| known.iter().any(|effect| effect.channels.contains(&channel));
    let moves = known.len() < diagnosis.chosen.len() || shows(Channel::Dx) || shows(Channel::Dy);
    if let Some(leading) = predicted(diagnosis).filter(|s| known.is_empty() || (moves && ratio(s) >= TELLING)) {
        return Some(leading);
    }
    let own =
        |s: &&Shrink| Channel::ALL.iter().any(|c| s.metric.strip_prefix("channel:") == Some(c.name()) && shows(*c));
    let by = |a: &&Shrink, b: &&Shrink| ratio(a).total_cmp(&ratio(b));
    diagnosis.how_far.iter().filter(own).max_by(by).or_else(|| diagnosis.how_far.iter().max_by(by))
}

/// Returns the metric that `predicted_share` is about.
pub(crate) fn predicted(diagnosis: &Diagnosis) -> Option<&Shrink> {
    ["position_2s", "image_rmse"].iter().find_map(|name| diagnosis.how_far.iter().find(|s| s.metric == *name))
}

/// Tells whether a metric is so near its floor that there is nothing to explain, once the ordinary mismatch is fitted.
pub(crate) fn at_floor(shrink: &Shrink) -> bool {
    shrink.share_explained.is_none()
}

/// Returns what a share of effects is a share of.
pub(crate) fn gap(shrink: &Shrink) -> String {
    let (metric, _) = words::metric(&shrink.metric);
    // earlier versions measured against the nominal simulator as it is
    let rest = if shrink.nuisance.is_some() { " that calibration leaves" } else { "" };
    format!("the gap in {metric}{rest}")
}

/// Returns the findings of the corrected model, likeliest first.
pub(crate) fn chosen(diagnosis: &Diagnosis) -> Vec<&Finding> {
    diagnosis.effects.iter().filter(|e| diagnosis.chosen.contains(&e.id)).collect()
}

/// Returns the probability of the verdict as it stands.
pub(crate) fn sure(diagnosis: &Diagnosis) -> f64 {
    match diagnosis.verdict {
        Verdict::None => diagnosis.p_none,
        Verdict::Unknown => diagnosis.p_unknown,
        Verdict::Single | Verdict::Multiple => chosen(diagnosis).iter().map(|e| e.probability).sum(),
    }
}

/// Returns an effect with its value in words.
fn named(diagnosis: &Diagnosis, finding: &Finding) -> String {
    let name = words::effect(&finding.id);
    let Some(estimate) = value::estimate(finding) else { return name };
    let whole = value::with_usual(diagnosis, finding).map(|whole| format!(" {whole}")).unwrap_or_default();
    format!("{name} ({}{whole})", estimate.value)
}

/// Returns the verdict, the effects, how far the gap shrinks and how sure that is.
pub(crate) fn sentence(diagnosis: &Diagnosis) -> String {
    let found = |id: &String| diagnosis.effects.iter().find(|e| e.id == *id);
    let name = |id: &String| found(id).map_or_else(|| words::effect(id), |e| named(diagnosis, e));
    let names: Vec<String> = diagnosis.chosen.iter().map(name).collect();
    let (names, many) = (words::list(&names), count(names.len()));
    let sure = words::chance(sure(diagnosis));
    match diagnosis.verdict {
        Verdict::None => format!("Nothing is missing beyond what every vehicle and sensor has: {sure} sure."),
        Verdict::Unknown if diagnosis.discovery.as_ref().is_some_and(|found| found.law.is_some()) => {
            let found = diagnosis.discovery.as_ref().map(law::sentence).unwrap_or_default();
            format!("{MISSING}: {sure} sure. {found}")
        }
        Verdict::Unknown => {
            let known = match names.as_str() {
                "" => String::new(),
                names => format!(" The nearest is {names}; {}", closes(diagnosis, "the simulator with it")),
            };
            let what = if needs_baseline(diagnosis) { FOREIGN } else { MISSING };
            format!("{what}: {sure} sure.{known}")
        }
        Verdict::Single => {
            format!("The simulator leaves out {names}, {sure} sure; {}", closes(diagnosis, "corrected, it"))
        }
        Verdict::Multiple => format!(
            "The simulator leaves out {many} effects: {names}, together {sure} sure; {}",
            closes(diagnosis, "corrected, it")
        ),
    }
}

/// What is said of a remainder that no vehicle has by nature, and of one that this vehicle may have.
const MISSING: &str = "Something is missing that no effect of the library explains";
const FOREIGN: &str = "The vehicle differs from the library's cars, by a trait or by a fault that no effect of the library explains: record three \
     healthy drives or more and make a baseline of them, which tells them apart";

/// Tells whether only healthy drives of the vehicle can say what is unknown.
fn needs_baseline(diagnosis: &Diagnosis) -> bool {
    diagnosis.unknown.as_ref().is_some_and(|unknown| unknown.unknown_kind == Unknown::NEEDS_BASELINE)
}

/// Returns what the data cannot tell from the chosen effects.
fn reservation(diagnosis: &Diagnosis) -> String {
    let told = |finding: &&Finding| {
        let rivals: Vec<String> =
            finding.group.iter().filter(|id| **id != finding.id).map(|id| words::effect(id)).collect();
        let own = words::effect(&finding.id);
        (!rivals.is_empty()).then(|| format!("These data cannot tell {own} from {}.", words::list(&rivals)))
    };
    chosen(diagnosis).iter().filter_map(told).collect::<Vec<_>>().join(" ")
}

fn count(number: usize) -> String {
    ["no", "one", "two", "three"].get(number).map_or_else(|| number.to_string(), |word| (*word).to_owned())
}

/// Returns how far the effects go beyond what the ordinary mismatch explains, which every vehicle has.
fn closes(diagnosis: &Diagnosis, who: &str) -> String {
    let Some(shrink) = telling(diagnosis) else { return "how far the gap shrinks was not measured.".to_owned() };
    let (metric, _) = words::metric(&shrink.metric);
    let Some(explained) = shrink.share_explained else {
        return format!("but calibration leaves no gap in {metric} beyond its noise floor {}.", data(shrink));
    };
    if explained < 0.0 {
        return format!("yet {metric} becomes worse when it is corrected {}.", data(shrink));
    }
    if explained > 1.0 {
        return format!("{who} closes {} to below its noise floor {}.", gap(shrink), data(shrink));
    }
    let interval = shrink.interval90.map(|ends| format!(" {}", words::shares(ends))).unwrap_or_default();
    format!("{who} closes {}{interval} of {} {}.", words::share(explained), gap(shrink), data(shrink))
}

/// Returns where a metric was measured.
pub(crate) fn data(shrink: &Shrink) -> &'static str {
    match shrink.data.as_str() {
        "heldout" => "on data kept from the fit",
        "crossfit" => "on every drive, by a fit without it",
        "unseen" => "on data never seen before",
        _ => "on the data of the fit",
    }
}

/// Returns the verdict in a word or two.
pub(crate) fn verdict(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::None => "nothing missing",
        Verdict::Single => "one effect",
        Verdict::Multiple => "several effects",
        Verdict::Unknown => "unknown effect",
    }
}

/// Writes the sentence, the main figures and the warnings.
pub(crate) fn header(m: &mut Markup, diagnosis: &Diagnosis) {
    m.inside("header", &[], |m| {
        m.inside("div", &[], |m| {
            m.inside("p", &[("class", &"brand")], |m| {
                m.text("DreamStream gap diagnosis · ");
                m.leaf("bdi", &[], &diagnosis.case);
            });
            m.leaf("h1", &[], sentence(diagnosis));
            let reservation = reservation(diagnosis);
            if !reservation.is_empty() {
                m.leaf("p", &[("class", &"lead")], reservation);
            }
            m.inside("ul", &[("class", &"tiles")], |m| tiles(m, diagnosis));
            if !diagnosis.warnings.is_empty() {
                m.inside("ul", &[("class", &"warnings"), ("aria-label", &"Warnings")], |m| {
                    for warning in &diagnosis.warnings {
                        m.inside("li", &[], |m| m.leaf("bdi", &[], warning));
                    }
                });
            }
        });
    });
}

fn tiles(m: &mut Markup, diagnosis: &Diagnosis) {
    let mut tile = |class: &str, value: &str, what: &str| {
        m.inside("li", &[("class", &class)], |m| {
            m.leaf("b", &[], value);
            m.leaf("span", &[], what);
        });
    };
    let alarm = if diagnosis.verdict == Verdict::Unknown { "alarm" } else { "" };
    tile(alarm, verdict(diagnosis.verdict), &format!("verdict, {} sure", words::chance(sure(diagnosis))));
    for finding in chosen(diagnosis) {
        if let Some(estimate) = value::estimate(finding) {
            let whole = value::with_usual(diagnosis, finding).map(|whole| format!(" {whole}")).unwrap_or_default();
            tile("", &estimate.value, &format!("{} {}{whole}", words::effect(&finding.id), estimate.interval));
        }
    }
    let told = telling(diagnosis).filter(|_| !diagnosis.chosen.is_empty());
    if let Some((shrink, explained)) = told.and_then(|shrink| Some((shrink, shrink.share_explained?))) {
        let from = shrink.nuisance.unwrap_or(shrink.before);
        let [before, after, _] = words::aligned([from, shrink.after, shrink.floor]);
        let (metric, unit) = words::metric(&shrink.metric);
        tile("", &words::share(explained.min(1.0)), &format!("of {} closed", gap(shrink)));
        tile("", &format!("{before} → {after}"), &format!("{metric}{}{unit}", if unit.is_empty() { "" } else { ", " }));
    }
    let beyond = diagnosis.cells.len();
    let most = diagnosis.cells.iter().map(|c| c.effect_size).fold(0.0, f64::max);
    if beyond > 0 {
        tile("", &format!("{} ×", words::figure(most)), "noise floor where the gap is largest");
    }
}

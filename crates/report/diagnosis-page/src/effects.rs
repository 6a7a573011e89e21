//! Which effect: every hypothesis with its probability, estimate and interval against what every vehicle has.
//!
//! Each row has an axis of its own, because effects share no unit: the neutral value is the upright line, the usual
//! mismatch (2.5 standard deviations, within which nothing is accused) the band. A limit has no neutral value; its axis
//! is logarithmic over the range searched, absent at the right end.

use ds_diagnosis::Verdict;
use ds_diagnosis::meta::Nominal;
use ds_diagnosis::schema::{Diagnosis, Finding};
use ds_dynamics::settings::MARGIN_SDS;
use ds_effect::{Parameter, Scale};

use super::markup::Markup;
use super::plot;
use super::value::{self, has_estimate};
use super::words;

/// Probability from which a hypothesis has a row of its own.
const SHOWN: f64 = 0.01;
/// Rows that are shown in any case, and at most.
const ROWS: (usize, usize) = (3, 9);
/// Width and height of a row's axis, px, and its margin for the ends of whiskers.
const AXIS: (f64, f64, f64) = (220.0, 34.0, 14.0);
/// Width of a full bar of probability, px.
const BAR: f64 = 110.0;

/// Writes the table of hypotheses; the nominal vehicle tells what a share of mass or of size is.
pub(crate) fn section(m: &mut Markup, diagnosis: &Diagnosis, nominal: Option<&Nominal>) {
    m.inside("p", &[("class", &"lead")], |m| {
        m.text(
            "Bars: probability of each explanation. Dot and whiskers: estimate with its 90 % interval; line: the effect is \
             absent; band: the mismatch that every vehicle has.",
        );
        if diagnosis.chosen.len() > 1 {
            m.text(" Effects found together share one probability.");
        }
    });
    let shown = shown(diagnosis);
    m.inside("div", &[("class", &"scroll"), ("tabindex", &0), ("role", &"region"), ("aria-label", &"Effects")], |m| {
        m.inside("table", &[("class", &"effects")], |m| {
            m.inside("thead", &[], |m| {
                m.inside("tr", &[], |m| {
                    for (class, title, hint) in [
                        ("", "explanation", ""),
                        ("", "probability", "all explanations, none and unknown included, sum to 100 %"),
                        ("n", "estimate", ""),
                        ("n", "90 % interval", ""),
                        ("", "against absence and the usual mismatch", ""),
                        ("n", "held-out gain", "log score gained on drives left out of the fit"),
                        ("n", "evidence", "log evidence over the fit without any effect"),
                    ] {
                        m.leaf("th", &[("scope", &"col"), ("class", &class), ("title", &hint)], title);
                    }
                });
            });
            m.inside("tbody", &[], |m| rows(m, diagnosis, &shown, nominal));
        });
    });
    rest(m, diagnosis, &shown);
}

/// Returns the findings with a row of their own.
pub(crate) fn shown(diagnosis: &Diagnosis) -> Vec<&Finding> {
    let worth = |(place, e): &(usize, &Finding)| {
        diagnosis.chosen.contains(&e.id) || *place < ROWS.0 || (*place < ROWS.1 && e.probability >= SHOWN)
    };
    let mut effects: Vec<&Finding> = diagnosis.effects.iter().collect();
    // What the data cannot show at all, such as followers' effects without a follower, is not the first to be named.
    effects.sort_by_key(|e| e.probability < SHOWN && !has_estimate(e) && !diagnosis.chosen.contains(&e.id));
    effects.into_iter().enumerate().filter(worth).map(|(_, e)| e).collect()
}

fn rows(m: &mut Markup, diagnosis: &Diagnosis, shown: &[&Finding], nominal: Option<&Nominal>) {
    let class = |verdict, class| if diagnosis.verdict == verdict { class } else { "p" };
    let none = ["Nothing missing", "only what every vehicle has", class(Verdict::None, "p chosen")];
    let unknown = ["Something unknown", "not in the library", class(Verdict::Unknown, "p alarm")];
    let mut others = vec![(none, diagnosis.p_none), (unknown, diagnosis.p_unknown)];
    others.sort_by(|a, b| a.1.total_cmp(&b.1));
    for finding in shown {
        while let Some((words, p)) = others.pop_if(|other| other.1 >= finding.probability) {
            other(m, words, p);
        }
        row(m, diagnosis, finding, nominal);
    }
    while let Some((words, p)) = others.pop() {
        other(m, words, p);
    }
}

fn row(m: &mut Markup, diagnosis: &Diagnosis, finding: &Finding, nominal: Option<&Nominal>) {
    let accepted = diagnosis.chosen.contains(&finding.id);
    m.inside("tr", &[("class", &if accepted { "chosen" } else { "" })], |m| {
        m.inside("th", &[("scope", &"row")], |m| {
            m.leaf("span", &[("class", &"what")], words::capital(&words::effect(&finding.id)));
            m.leaf("code", &[], &finding.id);
            let rivals: Vec<String> =
                finding.group.iter().filter(|id| **id != finding.id).map(|id| words::effect(id)).collect();
            if !rivals.is_empty() {
                m.leaf("span", &[("class", &"group")], format_args!("not told from {}", words::list(&rivals)));
            }
        });
        m.inside("td", &[], |m| bar(m, if accepted { "p chosen" } else { "p" }, finding.probability));
        match value::estimate(finding) {
            Some(estimate) => {
                m.inside("td", &[("class", &"n strong")], |m| {
                    m.text(estimate.value);
                    if let Some(whole) = value::with_usual(diagnosis, finding) {
                        m.leaf("span", &[("class", &"group")], whole);
                    }
                });
                m.leaf("td", &[("class", &"n range")], estimate.interval);
                m.inside("td", &[("class", &"axis")], |m| axis(m, finding, nominal));
            }
            None => {
                for class in ["n none", "n none", "none"] {
                    m.leaf("td", &[("class", &class)], words::NOTHING);
                }
            }
        }
        m.leaf("td", &[("class", &"n")], gain(finding.heldout_gain));
        m.leaf("td", &[("class", &"n range")], gain(Some(finding.evidence_gain)));
    });
}

fn other(m: &mut Markup, [title, note, class]: [&'static str; 3], p: f64) {
    m.inside("tr", &[("class", &"other")], |m| {
        m.inside("th", &[("scope", &"row")], |m| {
            m.leaf("span", &[("class", &"what")], title);
            m.leaf("span", &[("class", &"group")], note);
        });
        m.inside("td", &[], |m| bar(m, class, p));
        m.leaf("td", &[("colspan", &5)], "");
    });
}

fn gain(value: Option<f64>) -> String {
    let Some(value) = value.filter(|value| *value != 0.0) else { return words::NOTHING.to_owned() };
    let sign = if value > 0.0 { "+" } else { "" };
    format!("{sign}{}", words::fixed(value, usize::from(value.abs() < 9.95)))
}

fn bar(m: &mut Markup, class: &str, p: f64) {
    let words = words::chance(p);
    let width = if p.is_finite() { BAR * p.clamp(0.0, 1.0) } else { 0.0 };
    plot::picture(m, "inline", &format!("probability {words}"), (BAR + 54.0, 22.0), |m| {
        plot::area(m, "track", (0.0, 4.0), (BAR, 14.0), "");
        plot::area(m, class, (0.0, 4.0), (width, 14.0), "");
        plot::text(m, "value strong", (BAR + 53.0, 15.5), &words);
    });
}

/// Draws estimate and interval against the neutral value and the usual range.
fn axis(m: &mut Markup, finding: &Finding, nominal: Option<&Nominal>) {
    let Some(scale) = Axis::of(finding, nominal) else { return };
    let estimate = words::estimate(finding.value, finding.interval90, &finding.unit);
    let title = estimate.map(|e| format!("{} {}", e.value, e.interval)).unwrap_or_default();
    let middle = 12.0;
    plot::picture(m, "inline", &title, (AXIS.0, AXIS.1), |m| {
        plot::line(m, "base", (0.0, middle), (AXIS.0, middle));
        if let Some([low, high]) = scale.usual {
            let (x0, x1) = (scale.x(low), scale.x(high));
            let words = format!("usual: {} to {}", words::plain(low), words::plain(high));
            plot::area(m, "usual", (x0 - 0.5, middle - 8.0), ((x1 - x0).max(1.0), 16.0), &words);
        }
        absence(m, &scale, middle);
        let [low, high] = finding.interval90.map(|v| scale.x(v));
        if low.is_finite() && high.is_finite() {
            plot::line(m, "whisker", (low, middle), (high, middle));
            for end in [low, high] {
                plot::line(m, "whisker", (end, middle - 4.0), (end, middle + 4.0));
            }
        }
        plot::dot(m, "dot", (scale.x(finding.value), middle), 4.5);
    });
}

/// Draws the line of the neutral value; an effect that no library knows has none.
fn absence(m: &mut Markup, scale: &Axis, middle: f64) {
    let (at, words) = match scale.neutral {
        Some(neutral) => (scale.x(neutral), words::plain(neutral)),
        None if scale.logarithmic => (AXIS.0 - 1.0, "absent".to_owned()),
        None => return,
    };
    plot::line(m, "neutral", (at, middle - 10.0), (at, middle + 10.0));
    let class = match at {
        at if at > AXIS.0 - 30.0 => "tick end",
        at if at < 24.0 => "tick begin",
        _ => "tick",
    };
    plot::text(m, class, (at, AXIS.1 - 1.0), &words);
}

/// Returns the parameter that is reported as an effect's value, of a vehicle of the nominal one's size.
fn parameter(id: &str, nominal: Option<&Nominal>) -> Option<Parameter> {
    let parameters = ds_effect::find(id).map(|effect| effect.parameters);
    let first = *parameters.or_else(|| ds_effect::find_frame(id).map(|effect| effect.parameters))?.first()?;
    Some(nominal.map_or(first, |n| first.sized(n.lf + n.lr)))
}

/// The axis of one row, in reported units.
struct Axis {
    from: f64,
    to: f64,
    logarithmic: bool,
    neutral: Option<f64>,
    usual: Option<[f64; 2]>,
}

impl Axis {
    fn of(finding: &Finding, nominal: Option<&Nominal>) -> Option<Self> {
        let parameter = parameter(&finding.id, nominal);
        let mass_kg = nominal.map(|n| n.mass);
        let neutral = parameter.map(|p| p.reported(p.neutral, mass_kg.unwrap_or(1.0))).filter(|n| n.is_finite());
        let usual = parameter.and_then(|p| usual(&p, mass_kg));
        let logarithmic = parameter.is_some_and(|p| p.scale == Scale::Limit);
        let mut ends: Vec<f64> = finding.interval90.into_iter().chain([finding.value]).chain(neutral).collect();
        ends.extend(usual.iter().flatten());
        if let Some(p) = parameter.filter(|_| logarithmic) {
            ends.extend([p.slab.0.exp(), p.slab.1.exp()]);
        }
        ends.retain(|v| v.is_finite() && (!logarithmic || *v > 0.0));
        let from = ends.iter().copied().fold(f64::INFINITY, f64::min);
        let to = ends.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        (to > from).then_some(Self { from, to, logarithmic, neutral, usual })
    }

    fn x(&self, value: f64) -> f64 {
        let place = |v: f64| if self.logarithmic { v.max(1e-12).ln() } else { v };
        let share = (place(value) - place(self.from)) / (place(self.to) - place(self.from));
        AXIS.2 + (AXIS.0 - 2.0 * AXIS.2) * share.clamp(0.0, 1.0)
    }
}

/// Returns the range of values that accuse nothing. An estimate is told without the usual value, so that the range lies
/// around absence; only a parameter that is searched beyond absence is told as it is.
fn usual(parameter: &Parameter, mass_kg: Option<f64>) -> Option<[f64; 2]> {
    let nuisance = parameter.nuisance?;
    if parameter.scale == Scale::OfMass && mass_kg.is_none() {
        return None;
    }
    let centre = if parameter.slab.0 <= parameter.neutral { parameter.neutral } else { nuisance.mean };
    let end = |sds: f64| parameter.reported(centre + sds * nuisance.sd, mass_kg.unwrap_or(1.0));
    Some([end(-MARGIN_SDS), end(MARGIN_SDS)]).filter(|ends| ends.iter().all(|v| v.is_finite()))
}

/// Lists what has no row.
fn rest(m: &mut Markup, diagnosis: &Diagnosis, shown: &[&Finding]) {
    let rest: Vec<&Finding> =
        diagnosis.effects.iter().filter(|e| !shown.iter().any(|other| other.id == e.id)).collect();
    if rest.is_empty() {
        return;
    }
    let sum: f64 = rest.iter().map(|e| e.probability).filter(|p| p.is_finite()).sum();
    m.inside("details", &[], |m| {
        m.leaf("summary", &[], format_args!("{} further effects, together {}", rest.len(), words::chance(sum)));
        m.inside("p", &[("class", &"names")], |m| {
            for finding in rest {
                m.leaf("span", &[("title", &finding.id)], words::effect(&finding.id));
            }
        });
    });
}

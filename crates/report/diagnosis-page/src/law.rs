//! A law outside the library: where something acts, what it is, and its curve over the signal that moves it most.

use ds_diagnosis::discovery::{Discovery, EXTRAPOLATED, FoundLaw, LawKind};
use ds_effect::Law;
use ds_effect::law::{Felt, Sources};

use super::markup::Markup;
use super::plot;
use super::words;

/// Size of the plots, px, and the left and right ends of what is drawn.
const SIZE: (f64, f64) = (560.0, 240.0);
const ENDS: (f64, f64) = (90.0, 540.0);
const HIGH: f64 = 24.0;
const LOW: f64 = 196.0;
/// Points of a curve, seconds of a curve over time, and steps of the drive that leads to each point.
const POINTS: usize = 160;
const SPAN_SECS: f64 = 20.0;
const STEP_SECS: f64 = 0.02;
/// Share of its range at which a signal that is not drawn is held.
const HELD: f64 = 0.75;
/// Places with a bar.
const PLACES: usize = 6;

/// Says in one sentence what was found.
pub(crate) fn sentence(found: &Discovery) -> String {
    match (&found.law, found.insertion.first()) {
        (Some(law), Some(place)) => format!(
            "A law at the {} explains it, {} sure of the place: {}.{}",
            place_name(&place.id),
            words::chance(place.probability),
            equation(law),
            explained(found)
        ),
        (None, _) => found.note.as_ref().map(|note| format!("{}.", words::capital(note))).unwrap_or_default(),
        (Some(law), None) => format!("A law explains it: {}.", equation(law)),
    }
}

/// Returns what share of the gap the law explains, or why that is not known, as sentences of their own.
fn explained(found: &Discovery) -> String {
    let Some(share) = &found.share_explained else {
        let kept = found.kept_gain.map(|gain| {
            format!(" On drives kept from the fit its log score is {} over that without it.", words::fixed(gain, 1))
        });
        let note = found.note.as_ref().map(|note| format!(" {}.", words::capital(note)));
        return kept.into_iter().chain(note).collect();
    };
    let (metric, _) = words::metric(&share.metric);
    let on = if share.on == "heldout" { "on drives kept from the fit" } else { "on the drives of the fit" };
    format!(" It explains {} of the gap in {metric} that calibration leaves, {on}.", words::share(share.value))
}

/// Returns the law as an equation, without ranges; of a table what it is made of.
fn equation(law: &FoundLaw) -> String {
    if law.kind == LawKind::Table {
        return format!("u is {}", table(law));
    }
    let sum: Vec<String> = law
        .terms
        .iter()
        .enumerate()
        .map(|(k, term)| {
            let sign = match (k, term.coefficient < 0.0) {
                (0, true) => "−",
                (0, false) => "",
                (_, true) => " − ",
                (_, false) => " + ",
            };
            let factor = words::figure(term.coefficient.abs());
            if term.expression == "1" {
                format!("{sign}{factor}")
            } else {
                format!("{sign}{factor}·{}", term.expression.replace('*', "·"))
            }
        })
        .collect();
    format!("u = {} {}", sum.concat(), law.unit)
}

/// Says how many knots a table has, over which signal, what it is multiplied by, and from which height to which it goes.
fn table(law: &FoundLaw) -> String {
    let parsed = Law::parse(&law.text).ok();
    let signal = parsed.as_ref().and_then(|law| law.terms().iter().find_map(|term| term.expression.knot_of()));
    let first = law.terms.first().map_or("", |term| &term.expression);
    let (carrier, knot) = first.rsplit_once('*').unwrap_or(("", first));
    let over = match knot.strip_prefix("beat(").and_then(|beat| beat.split_once(';')) {
        Some((period, _)) => format!(" over a period of {period} s"),
        None => signal.map(|name| format!(" over {}", signal_name(name))).unwrap_or_default(),
    };
    let times = if carrier.is_empty() { String::new() } else { format!(", times {}", carrier.replace('*', "·")) };
    let [low, high] = <[f64; 2]>::from(ends(law.terms.iter().map(|term| term.coefficient))).map(words::figure);
    format!("a table of {} knots{over}, from {low} to {high}{times}, in {}", law.terms.len(), law.unit)
}

/// Returns a point of the loop in words.
pub(crate) fn place_name(id: &str) -> String {
    match id {
        "steering" => "steering".to_owned(),
        "drive" => "drive".to_owned(),
        "lateral.front" => "front axle".to_owned(),
        "lateral.rear" => "rear axle".to_owned(),
        "lateral.body" => "body, from the side".to_owned(),
        "follower" => "followers".to_owned(),
        "sensor.x" => "position east".to_owned(),
        "sensor.y" => "position north".to_owned(),
        "sensor.yaw" => "sensor of heading".to_owned(),
        other => format!("sensor of {}", words::channel(other.strip_prefix("sensor.").unwrap_or(other))),
    }
}

/// Writes the section.
pub(crate) fn section(m: &mut Markup, found: &Discovery) {
    m.leaf("p", &[("class", &"said")], sentence(found));
    places(m, found);
    let Some(law) = &found.law else { return };
    terms(m, law);
    if let Some(share) = found.extrapolated_share.filter(|share| *share > EXTRAPOLATED) {
        m.leaf("p", &[("class", &"lead")], format_args!("{} of what it was measured on lies beyond the ranges on which it was found: there a signal counts as at their ends, a table as 0.", words::share(share)));
    }
    if !law.stable {
        m.leaf(
            "p",
            &[("class", &"lead")],
            "Refits without one drive keep other terms: read the curve, not the single terms.",
        );
    }
    if let Ok(parsed) = Law::parse(&law.text) {
        curve(m, &parsed, law);
    }
    m.leaf("p", &[("class", &"lead")], format_args!("To run it: --law \"{}\". Ranges in brackets are those of the drives; beyond them a signal counts as at their end.", law.text));
    if !law.equivalent.is_empty() {
        m.leaf(
            "p",
            &[("class", &"lead")],
            format_args!("These data cannot tell it from: {}.", law.equivalent.join("; ")),
        );
    }
}

fn places(m: &mut Markup, found: &Discovery) {
    let mut rows: Vec<(String, f64)> =
        found.insertion.iter().take(PLACES).map(|p| (place_name(&p.id), p.probability)).collect();
    rows.push(("nowhere".to_owned(), found.p_none));
    let height = 24.0 + 24.0 * rows.len() as f64;
    plot::picture(m, "plot bars", "Where something acts", (560.0, height), |m| {
        plot::text(m, "tick begin", (190.0, 12.0), "probability that something acts there");
        for (k, (name, p)) in rows.iter().enumerate() {
            let y = 22.0 + 24.0 * k as f64;
            plot::text(m, "label", (178.0, y + 13.5), &plot::short(name, 26));
            plot::area(m, "share", (190.0, y + 2.0), (300.0 * p.clamp(0.0, 1.0), 15.0), "");
            plot::text(m, "value strong", (550.0, y + 14.0), &words::chance(*p));
        }
    });
}

fn terms(m: &mut Markup, law: &FoundLaw) {
    m.inside("div", &[("class", &"scroll"), ("tabindex", &0), ("role", &"region"), ("aria-label", &"Terms")], |m| {
        m.inside("table", &[], |m| {
            m.inside("thead", &[], |m| {
                m.inside("tr", &[], |m| {
                    for (class, title) in [("", "term"), ("n", "coefficient"), ("n", "90 % interval")] {
                        m.leaf("th", &[("scope", &"col"), ("class", &class)], title);
                    }
                });
            });
            m.inside("tbody", &[], |m| {
                for term in &law.terms {
                    m.inside("tr", &[], |m| {
                        m.leaf("td", &[], term.expression.replace('*', "·"));
                        m.leaf("td", &[("class", &"n")], words::figure(term.coefficient));
                        let [low, high] = term.interval90.map(words::figure);
                        m.leaf("td", &[("class", &"n")], format_args!("[{low}, {high}]"));
                    });
                }
            });
        });
    });
}

/// A law's value along one signal, the others held.
struct Curve {
    signal: String,
    points: Vec<(f64, f64)>,
}

impl Curve {
    /// Returns the curve over the signal along which the law changes most; of a table over that which it runs over.
    fn of(law: &Law) -> Option<Self> {
        let read = law.ranges();
        let held = |name: &str| read.get(name).map_or(0.0, |[low, high]| low + HELD * (high - low));
        let mut curves: Vec<Self> = Vec::new();
        if law.terms().iter().any(|term| term.expression.oscillates()) {
            curves.push(Self { signal: "t".to_owned(), points: over_time(law, &held) });
        }
        for (name, [low, high]) in &read {
            let at = |k: usize| low + (high - low) * k as f64 / (POINTS - 1) as f64;
            let value = |x: f64| last(law, &|other: &str| if other == *name { x } else { held(other) });
            let points = (0..POINTS).map(|k| (at(k), value(at(k)))).collect();
            curves.push(Self { signal: (*name).to_owned(), points });
        }
        if let Some(over) = law.terms().iter().find_map(|term| term.expression.knot_of()) {
            curves.retain(|curve| curve.signal == over);
        }
        curves.into_iter().max_by(|a, b| a.range().total_cmp(&b.range()))
    }

    fn range(&self) -> f64 {
        let (low, high) = ends(self.points.iter().map(|p| p.1));
        high - low
    }
}

fn ends(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)))
}

/// Returns the law at the end of a drive that leads to some values of its signals.
fn last(law: &Law, value: &dyn Fn(&str) -> f64) -> f64 {
    series(law, 100, value).last().copied().unwrap_or_default()
}

fn over_time(law: &Law, held: &dyn Fn(&str) -> f64) -> Vec<(f64, f64)> {
    let count = (SPAN_SECS / STEP_SECS) as usize;
    series(law, count, held).into_iter().enumerate().map(|(k, u)| (k as f64 * STEP_SECS, u)).step_by(4).collect()
}

/// Returns the law along a drive in which every signal is even but for a steering angle that turns at its rate.
fn series(law: &Law, count: usize, value: &dyn Fn(&str) -> f64) -> Vec<f64> {
    let turned = |k: usize| value("delta") - value("delta_rate") * (count - 1 - k) as f64 * STEP_SECS;
    let delta: Vec<f64> = (0..count).map(turned).collect();
    let (accel, speed) = (vec![value("accel"); count], vec![value("v"); count]);
    let known = law.known(&Sources { step_secs: STEP_SECS, delta: &delta, accel: &accel, speed: &speed });
    let felt = Felt {
        v: value("v"),
        ax: value("ax"),
        ay: value("ay"),
        yaw_rate: value("yaw_rate"),
        slip_front: value("slip_front"),
        slip_rear: value("slip_rear"),
        gap: value("gap"),
        dv: value("dv"),
        v_lead: value("v_lead"),
    };
    let term = |term: usize, k: usize| known[term].get(k).copied().unwrap_or(1.0);
    (0..count).map(|k| law.at(|t| term(t, k), &felt)).collect()
}

fn curve(m: &mut Markup, law: &Law, found: &FoundLaw) {
    let Some(curve) = Curve::of(law) else { return };
    let ((from, to), (least, most)) = (ends(curve.points.iter().map(|p| p.0)), ends(curve.points.iter().map(|p| p.1)));
    let (least, most) = (least.min(0.0), most.max(0.0));
    if !(to > from && most > least) {
        return;
    }
    let x = |value: f64| ENDS.0 + (ENDS.1 - ENDS.0) * (value - from) / (to - from);
    let y = |value: f64| LOW - (LOW - HIGH) * (value - least) / (most - least);
    plot::picture(m, "plot bars", "The law over its signal", SIZE, |m| {
        plot::text(
            m,
            "tick begin",
            (ENDS.0, 14.0),
            &format!("u at {} [{}], other signals at three quarters of their range", found.port, found.unit),
        );
        for value in [least, 0.0, most] {
            plot::line(m, if value == 0.0 { "zero" } else { "grid" }, (ENDS.0, y(value)), (ENDS.1, y(value)));
        }
        plot::text(m, "label", (ENDS.0 - 8.0, y(most) + 4.0), &words::figure(most));
        plot::text(m, "label", (ENDS.0 - 8.0, y(least) + 4.0), &words::figure(least));
        let points: Vec<(f64, f64)> = curve.points.iter().map(|p| (x(p.0), y(p.1))).collect();
        plot::path(m, "whisker curve", &points);
        for value in [from, 0.5 * (from + to), to] {
            plot::text(m, "tick", (x(value), LOW + 16.0), &words::figure(value));
        }
        plot::text(m, "tick", (0.5 * (ENDS.0 + ENDS.1), LOW + 34.0), signal_name(&curve.signal));
    });
}

/// Returns a signal in words, with its unit.
fn signal_name(name: &str) -> &'static str {
    match name {
        "delta" => "steering angle, rad",
        "delta_rate" => "rate of the steering angle, rad/s",
        "accel" => "acceleration asked for, m/s²",
        "t" => "time since the start, s",
        "s" => "way since the start, m",
        "v" => "speed, m/s",
        "ax" => "acceleration forward, m/s²",
        "ay" => "acceleration to the left, m/s²",
        "yaw_rate" => "yaw rate, rad/s",
        "slip_front" => "slip angle in front, rad",
        "slip_rear" => "slip angle at the rear, rad",
        "gap" => "gap, m",
        "dv" => "speed of the vehicle ahead less the own, m/s",
        "v_lead" => "speed of the vehicle ahead, m/s",
        _ => "",
    }
}

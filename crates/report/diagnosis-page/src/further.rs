//! What remains open: a remainder that no effect explains, effects that these data cannot tell apart, what to drive
//! next, and the corrected simulator as it stands.

use ds_diagnosis::schema::{Diagnosis, Remainder};

use super::markup::Markup;
use super::plot;
use super::words;

/// Writes what no library effect explains.
pub(crate) fn remainder(m: &mut Markup, left: &Remainder) {
    m.leaf("p", &[("class", &"said")], format_args!("{}.", words::capital(left.text.trim_end_matches('.'))));
    m.inside("dl", &[], |m| {
        let mut entry = |title: &str, text: String| {
            if !text.is_empty() {
                m.leaf("dt", &[], title);
                m.leaf("dd", &[], text);
            }
        };
        entry("in time", left.time_pattern.clone());
        entry("frequency", left.frequency_hz.map(|f| format!("{} Hz", words::figure(f))).unwrap_or_default());
        let goes = |(name, r): &(String, f64)| format!("{name} (correlation {})", words::fixed(*r, 2));
        entry("goes with", left.goes_with.as_ref().map(goes).unwrap_or_default());
        entry("drives", left.drives.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "));
        entry("nearest effects", words::list(&left.nearest.iter().map(|id| words::effect(id)).collect::<Vec<_>>()));
    });
    let mut channels: Vec<(&String, f64)> = left.channels.iter().map(|(name, times)| (name, *times)).collect();
    channels.sort_by(|a, b| b.1.total_cmp(&a.1));
    if channels.is_empty() {
        return;
    }
    let most = channels.iter().map(|c| c.1).filter(|v| v.is_finite()).fold(1.0, f64::max);
    let height = 24.0 + 24.0 * channels.len() as f64;
    plot::picture(m, "plot bars", "Remainder by channel", (560.0, height), |m| {
        plot::text(m, "tick begin", (160.0, 12.0), "times the clean level, after the best effects");
        for (k, (name, times)) in channels.iter().enumerate() {
            let y = 22.0 + 24.0 * k as f64;
            plot::text(m, "label", (148.0, y + 13.5), &plot::short(&words::channel(name), 22));
            plot::area(m, "share", (160.0, y + 2.0), (330.0 * (times / most).clamp(0.0, 1.0), 15.0), "");
            plot::text(m, "value strong", (550.0, y + 14.0), &words::fixed(*times, 1));
        }
    });
}

/// Writes groups and manoeuvres.
pub(crate) fn next(m: &mut Markup, diagnosis: &Diagnosis) {
    if !diagnosis.indistinguishable.is_empty() {
        m.leaf("p", &[("class", &"lead")], "These data cannot tell apart:");
        m.inside("ul", &[("class", &"groups")], |m| {
            for group in &diagnosis.indistinguishable {
                m.inside("li", &[], |m| {
                    for (k, id) in group.iter().enumerate() {
                        if k > 0 {
                            m.leaf("i", &[], "or");
                        }
                        m.leaf("b", &[("title", id)], words::effect(id));
                    }
                });
            }
        });
    }
    if diagnosis.next_manoeuvre.is_empty() {
        return;
    }
    let factors = diagnosis.next_manoeuvre.iter().map(|n| n.expected_log_bayes_factor);
    let most = factors.filter(|f| f.is_finite()).fold(5.0, f64::max);
    m.leaf(
        "p",
        &[("class", &"lead")],
        "Manoeuvres that separate the two best explanations of the vehicle's motion. A log Bayes factor of 5 (the line) settles \
         it.",
    );
    m.inside(
        "div",
        &[("class", &"scroll"), ("tabindex", &0), ("role", &"region"), ("aria-label", &"Manoeuvres")],
        |m| {
            m.inside("table", &[("class", &"next")], |m| {
                m.inside("thead", &[], |m| {
                    m.inside("tr", &[], |m| {
                        for (class, title) in [
                            ("", "manoeuvre"),
                            ("", "separates"),
                            ("", "expected log Bayes factor of one run"),
                            ("n", "time needed"),
                        ] {
                            m.leaf("th", &[("scope", &"col"), ("class", &class)], title);
                        }
                    });
                });
                m.inside("tbody", &[], |m| {
                    for run in &diagnosis.next_manoeuvre {
                        m.inside("tr", &[], |m| {
                            m.leaf("th", &[("scope", &"row")], words::capital(&run.name.replace('_', " ")));
                            let [a, b] = run.separates.each_ref().map(|id| words::effect(id));
                            m.leaf("td", &[], format_args!("{a} from {b}"));
                            m.inside("td", &[], |m| factor(m, run.expected_log_bayes_factor, most));
                            let hopeless = run.expected_log_bayes_factor < 1e-3;
                            let time =
                                if hopeless { "does not help".to_owned() } else { words::duration(run.secs_needed) };
                            m.leaf("td", &[("class", &"n")], time);
                        });
                    }
                });
            });
        },
    );
}

fn factor(m: &mut Markup, value: f64, most: f64) {
    let words = words::fixed(value, usize::from(value.abs() < 9.95));
    let place = |v: f64| if v.is_finite() { 200.0 * (v.max(0.0).ln_1p() / most.ln_1p()).min(1.0) } else { 0.0 };
    plot::picture(m, "inline", &format!("log Bayes factor {words}"), (270.0, 22.0), |m| {
        plot::area(m, "track", (0.0, 4.0), (200.0, 14.0), "");
        plot::area(m, "p", (0.0, 4.0), (place(value), 14.0), "");
        plot::line(m, "neutral", (place(5.0), 1.0), (place(5.0), 21.0));
        plot::text(m, "value strong", (268.0, 15.5), &words);
    });
}

/// Writes how the page is to be read, and the corrected simulator.
pub(crate) fn method(m: &mut Markup, diagnosis: &Diagnosis, note: Option<&str>) {
    m.inside("dl", &[], |m| {
        let floor = match diagnosis.floor_source.as_str() {
            "practice" => "what remains between effect-free practice drives and the simulator".to_owned(),
            "self" => "estimated from this log itself, hence less certain".to_owned(),
            other => other.to_owned(),
        };
        for (title, text) in [
            ("noise floor", floor),
            (
                "usual mismatch",
                "fitted first in every explanation; an effect has to leave it by 2.5 standard deviations".to_owned(),
            ),
            ("probability", "tempered model evidence; near the ends it is too sure".to_owned()),
            (
                "share explained",
                "1 − (after − floor) / (before − floor), with a 90 % interval by block bootstrap".to_owned(),
            ),
            ("corrected", "the simulator with the chosen effects and the fitted usual mismatch".to_owned()),
        ] {
            m.leaf("dt", &[], title);
            m.leaf("dd", &[], text);
        }
        if let Some(note) = note {
            m.leaf("dt", &[], "without drive plots");
            m.leaf("dd", &[], note);
        }
        m.leaf("dt", &[], "made");
        m.leaf(
            "dd",
            &[],
            format_args!("schema {}, {} of computing", diagnosis.schema_version, words::duration(diagnosis.secs)),
        );
    });
    let model = &diagnosis.corrected_model;
    if model.effects.is_empty() && model.nuisance.is_empty() {
        return;
    }
    m.inside("details", &[], |m| {
        m.leaf("summary", &[], "The corrected simulator, value by value");
        m.inside("table", &[("class", &"model")], |m| {
            m.inside("tbody", &[], |m| {
                for effect in &model.effects {
                    m.inside("tr", &[("class", &"chosen")], |m| {
                        m.inside("th", &[("scope", &"row")], |m| m.leaf("code", &[], &effect.id));
                        let values: Vec<String> = effect.values.iter().map(|v| words::figure(*v)).collect();
                        m.leaf("td", &[("class", &"n")], values.join(", "));
                        m.leaf("td", &[], "effect");
                    });
                }
                for (id, value) in &model.nuisance {
                    m.inside("tr", &[], |m| {
                        m.inside("th", &[("scope", &"row")], |m| m.leaf("code", &[], id));
                        m.leaf("td", &[("class", &"n")], words::figure(*value));
                        m.leaf("td", &[("class", &"range")], "usual mismatch");
                    });
                }
            });
        });
    });
}

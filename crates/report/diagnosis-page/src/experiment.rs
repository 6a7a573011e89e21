//! The next experiment: what to drive, which hypotheses it tells apart, what each predicts, what it leaves of the envelope,
//! and the runs that were driven.

use std::fmt::Write as _;

use ds_experiment::{Curve, Curves, Margin, Next, Planned};

use super::blocks::{head, section, table};
use super::index::tile;
use super::markup::Markup;
use super::plot;
use super::words;

const LEFT: f64 = 62.0;
const RIGHT: f64 = 860.0;
const HEIGHT: f64 = 210.0;
/// Classes of the hypotheses' curves, likeliest first.
const CLASSES: [&str; 5] = ["c0", "c1", "c2", "c3", "c4"];

/// Returns the text.
pub(crate) fn text(next: &Next) -> String {
    let mut text = format!("{}: {}", next.case, hypotheses(next).join(", "));
    for run in &next.runs {
        let left = if run.left_envelope { "; the car left the envelope" } else { "" };
        let _infallible = write!(
            text,
            "\nrun {} ({}, {} nat expected): {} {:.3}{left}",
            run.run,
            run.from,
            words::figure(run.nats),
            name(&run.effects),
            run.probability
        );
    }
    for refused in &next.refused {
        let _infallible = write!(text, "\nrun {} ({}) counts for nothing: {}", refused.run, refused.from, refused.why);
    }
    if let Some(ended) = &next.ended {
        let _infallible = write!(text, "\n{ended}");
        return text;
    }
    let Some(planned) = &next.planned else { return text };
    let _infallible = write!(
        text,
        "\ndrive: {}, {} s, tells {} of {} nat",
        planned.from,
        planned.secs,
        words::figure(planned.nats),
        words::figure(next.entropy_nats)
    );
    let numbers: Vec<String> = planned.design.iter().map(|(key, value)| format!("{key} {value:.2}")).collect();
    let _infallible = write!(text, "\n  {}", numbers.join(", "));
    for pair in planned.separates.iter().take(3) {
        let _infallible =
            write!(text, "\n  {} from {}: {} nat", name(&pair.one), name(&pair.other), words::figure(pair.nats));
    }
    for m in &planned.envelope.margins {
        let (reached, limit) = (words::figure(m.reached), words::figure(m.limit));
        let line = format!("{}: {reached} of {limit} {}", m.name, words::unit(&m.unit));
        let _infallible = write!(text, "\n  {}", line.trim_end());
    }
    text
}

fn hypotheses(next: &Next) -> Vec<String> {
    next.hypotheses.iter().map(|h| format!("{} {:.3}", name(&h.effects), h.probability)).collect()
}

/// Returns a hypothesis in words.
fn name(effects: &[String]) -> String {
    if effects.is_empty() {
        return "ordinary mismatch".to_owned();
    }
    let each: Vec<String> = effects.iter().map(|id| words::effect(id)).collect();
    words::list(&each)
}

/// Writes the body of the page.
pub(crate) fn body(m: &mut Markup, next: &Next) {
    head(m, &format!("What to drive next: {}", next.case), |m| {
        m.inside("ul", &[("class", &"tiles")], |m| {
            tile(m, next.hypotheses.len(), "hypotheses", "");
            tile(m, next.runs.len(), "runs driven", "");
            if !next.refused.is_empty() {
                tile(m, next.refused.len(), "refused", "alarm");
            }
            let left = next.runs.iter().filter(|run| run.left_envelope).count();
            tile(m, left, "left the envelope", if left > 0 { "alarm" } else { "" });
        });
        if let Some(ended) = &next.ended {
            m.leaf("p", &[("class", &"said")], format_args!("{}.", words::capital(ended)));
        }
    });
    m.inside("main", &[], |m| {
        told(m, next);
        if let Some(planned) = &next.planned {
            manoeuvre(m, next, planned);
            predictions(m, planned);
            let title = format!("The envelope, in {} draws", planned.envelope.draws);
            section(m, &title, |m| margins(m, &planned.envelope.margins));
        }
        runs(m, next);
    });
}

fn told(m: &mut Markup, next: &Next) {
    section(m, "What is still open", |m| {
        let row = |h: &ds_experiment::Hypothesis| vec![name(&h.effects), words::chance(h.probability)];
        let rows: Vec<Vec<String>> = next.hypotheses.iter().map(row).collect();
        table(m, "Hypotheses", &["hypothesis", "probability"], &rows);
        let (nats, unknown) = (words::figure(next.entropy_nats), words::chance(next.p_unknown));
        m.leaf(
            "p",
            &[("class", &"lead")],
            format_args!("{nats} nat are open among them. That it is none of these has a probability of {unknown}; no manoeuvre is designed for that."),
        );
    });
}

fn manoeuvre(m: &mut Markup, next: &Next, planned: &Planned) {
    section(m, "The manoeuvre", |m| {
        let (nats, open) = (words::figure(planned.nats), words::figure(next.entropy_nats));
        let text = format!(
            "{}, {} s long. Its log tells at least {nats} of {open} nat. The commands to drive are in commands.csv.",
            words::capital(&planned.from),
            planned.secs
        );
        m.leaf("p", &[("class", &"said")], text);
        let row = |(key, value): (&String, &f64)| vec![key.replace('_', " "), words::figure(*value)];
        table(m, "Numbers of the manoeuvre", &["number", "value"], &planned.design.iter().map(row).collect::<Vec<_>>());
        m.leaf("h3", &[], "Which hypotheses it tells apart");
        let row = |p: &ds_experiment::Pair| vec![name(&p.one), name(&p.other), words::figure(p.nats)];
        let rows: Vec<Vec<String>> = planned.separates.iter().map(row).collect();
        table(m, "Pairs", &["one", "the other", "distance, nat"], &rows);
        m.inside("details", &[], |m| {
            m.leaf("summary", &[], format_args!("What else was considered, in {} simulated drives", planned.rollouts));
            let holds = |held: Option<bool>| match held {
                Some(true) => "holds",
                Some(false) => "leaves it",
                None => words::NOTHING,
            };
            let row =
                |c: &ds_experiment::Considered| vec![c.from.clone(), words::figure(c.nats), holds(c.holds).to_owned()];
            let rows: Vec<Vec<String>> = planned.considered.iter().map(row).collect();
            table(m, "Considered", &["manoeuvre", "nat", "envelope"], &rows);
        });
    });
}

fn predictions(m: &mut Markup, planned: &Planned) {
    let Some(first) = planned.predicted.first() else { return };
    section(m, "What each hypothesis predicts", |m| {
        m.inside("ul", &[("class", &"legend")], |m| {
            for (curve, class) in first.each.iter().zip(CLASSES) {
                m.inside("li", &[], |m| {
                    m.leaf("span", &[("class", &format_args!("swatch s-{class}")), ("aria-hidden", &"true")], "");
                    m.text(name(&curve.effects));
                });
            }
        });
        planned.predicted.iter().for_each(|curves| picture(m, curves));
    });
}

/// Draws by how much each hypothesis differs from the likeliest: beside the way of the car itself nobody would see it.
fn picture(m: &mut Markup, curves: &Curves) {
    let (title, unit) = words::metric(&format!("channel:{}", curves.channel));
    let Some(likeliest) = curves.each.first() else { return };
    let less = |c: &Curve| c.values.iter().zip(&likeliest.values).map(|(a, b)| a - b).collect::<Vec<f64>>();
    let each: Vec<Vec<f64>> = curves.each.iter().map(less).collect();
    let values = || each.iter().flatten().copied();
    let (low, high) = values().fold((-curves.noise, curves.noise), |(a, b), v| (a.min(v), b.max(v)));
    let (Some(from), Some(to)) = (curves.t.first(), curves.t.last()) else { return };
    let (low, high) = if high > low { (low, high) } else { (low - 1.0, low + 1.0) };
    let x = |t: f64| LEFT + (RIGHT - LEFT) * (t - from) / (to - from).max(1e-9);
    let y = |v: f64| HEIGHT - 34.0 - (HEIGHT - 66.0) * (v - low) / (high - low);
    plot::wide(m, &format!("Predicted {title}"), HEIGHT, |m| {
        let named = format!("{} less that of {}, {unit}", words::capital(&title), name(&likeliest.effects));
        plot::text(m, "name", (LEFT, 18.0), &named);
        for value in [low, 0.5 * (low + high), high] {
            plot::line(m, "grid", (LEFT, y(value)), (RIGHT, y(value)));
            plot::text(m, "tick end", (LEFT - 7.0, y(value) + 4.0), &words::figure(value));
        }
        for k in 0..=(to - from) as usize / 3 {
            let t = from + 3.0 * k as f64;
            plot::text(m, "tick", (x(t), HEIGHT - 12.0), &words::plain(t));
        }
        for (values, class) in each.iter().zip(CLASSES).rev() {
            let points: Vec<(f64, f64)> = curves.t.iter().zip(values).map(|(t, v)| (x(*t), y(*v))).collect();
            plot::path(m, &format!("curve {class}"), &points);
        }
        plot::text(
            m,
            "tick begin",
            (RIGHT + 14.0, 60.0),
            &format!("noise of the sensor {}", words::figure(curves.noise)),
        );
        plot::text(m, "tick begin", (RIGHT + 14.0, HEIGHT - 12.0), "seconds");
    });
}

fn margins(m: &mut Markup, all: &[Margin]) {
    let row = |margin: &Margin| {
        let unit = words::unit(&margin.unit);
        let with = |value: f64| format!("{} {unit}", words::figure(value));
        vec![margin.name.clone(), with(margin.limit), with(margin.reached), words::share(margin.left)]
    };
    let rows: Vec<Vec<String>> = all.iter().map(row).collect();
    table(m, "Envelope", &["limit of", "limit", "nearest to it", "left"], &rows);
}

fn runs(m: &mut Markup, next: &Next) {
    if next.runs.is_empty() && next.refused.is_empty() {
        return;
    }
    section(m, "Runs", |m| {
        let row = |run: &ds_experiment::Run| {
            let envelope = if run.left_envelope { "left" } else { "held" };
            vec![
                run.run.to_string(),
                run.from.clone(),
                words::figure(run.nats),
                name(&run.effects),
                words::chance(run.probability),
                envelope.to_owned(),
            ]
        };
        let rows: Vec<Vec<String>> = next.runs.iter().map(row).collect();
        let columns = ["run", "manoeuvre", "nat expected", "likeliest after it", "probability", "envelope"];
        table(m, "Runs", &columns, &rows);
        let row = |r: &ds_experiment::Refused| vec![r.run.to_string(), r.from.clone(), r.why.clone()];
        let rows: Vec<Vec<String>> = next.refused.iter().map(row).collect();
        if !rows.is_empty() {
            table(m, "Runs that count for nothing", &["run", "manoeuvre", "why"], &rows);
        }
    });
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use ds_experiment::{Checked, Envelope, Hypothesis, Pair, Refused};

    use super::*;

    fn next() -> Next {
        let effects = |id: &str| vec![id.to_owned()];
        let curve = |id: &str, size: f64| Curve { effects: effects(id), values: vec![0.0, size, 0.0] };
        Next {
            schema_version: 1,
            case: "van <7>".to_owned(),
            seed: 1,
            hypotheses: vec![
                Hypothesis { effects: effects("steer_delay"), probability: 0.6 },
                Hypothesis { effects: Vec::new(), probability: 0.4 },
            ],
            p_unknown: 0.1,
            entropy_nats: 0.67,
            planned: Some(Planned {
                from: "slalom, changed".to_owned(),
                design: BTreeMap::from([("speed_mps".to_owned(), 12.5)]),
                secs: 16.0,
                nats: 0.5,
                separates: vec![Pair { one: effects("steer_delay"), other: Vec::new(), nats: 3.0 }],
                envelope: Checked {
                    limits: Envelope::default(),
                    draws: 300,
                    margins: Envelope::default().margins(std::iter::empty()),
                },
                considered: Vec::new(),
                rollouts: 590,
                predicted: vec![Curves {
                    channel: "yaw_rate".to_owned(),
                    t: vec![0.0, 1.0, 2.0],
                    each: vec![curve("steer_delay", 0.2), curve("steer_lag", 0.1)],
                    noise: 0.003,
                }],
            }),
            runs: Vec::new(),
            refused: Vec::new(),
            ended: None,
        }
    }

    #[test]
    fn page_and_text_say_what_to_drive_and_what_it_tells_apart() {
        let next = next();
        let page = crate::experiment(&next);
        for needed in
            ["van &lt;7&gt;", "Slalom, changed", "steering delay", "curve c0", "curve c1", "demand on the tyres"]
        {
            assert!(page.contains(needed), "{needed} is not on the page");
        }
        let said = text(&next);
        assert!(said.contains("drive: slalom, changed, 16 s, tells 0.500 of 0.670 nat"), "{said}");
        let (from, why) = ("step steer".to_owned(), "frozen <v>".to_owned());
        let refused = vec![Refused { run: 1, from, design: BTreeMap::new(), why }];
        let next = Next { ended: Some("settled".to_owned()), refused, ..next };
        assert!(
            text(&next).ends_with("\nrun 1 (step steer) counts for nothing: frozen <v>\nsettled"),
            "{}",
            text(&next)
        );
        assert!(crate::experiment(&next).contains("frozen &lt;v&gt;"));
    }
}

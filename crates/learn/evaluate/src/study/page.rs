//! The page of a study over frames: what its sources show, what it found, FDπ with its intervals, every table, the scenes
//! that differ.

mod attended;
pub(crate) mod closed;
mod findings;
mod parts;

use std::collections::BTreeMap;

use ds_page::svg::{dot, line, short, text, wide};
use ds_page::{Document, Markup, Pictures, link};

use super::outcome::{Anchor, Figure, Outcome, Row, Scene, Table};
use crate::page::table::table;

const STYLE: &str = include_str!("../page/page.css");

/// Returns the page.
pub(super) fn html(outcome: &Outcome) -> String {
    let title = title(&outcome.study);
    let document = Document { title, style: STYLE, script: None, pictures: Pictures::Beside };
    document.page(|m| {
        m.inside("main", &[], |m| match &outcome.parts {
            Some(found) => parts::body(m, outcome, found),
            None => body(m, outcome),
        });
    })
}

fn body(m: &mut Markup, outcome: &Outcome) {
    m.leaf("h1", &[], title(&outcome.study));
    m.leaf(
        "p",
        &[("class", &"lead")],
        format_args!(
            "{}; half of them beside the log. The real set is the camera of the project's \
             own world {}: every figure is {}, not sim-to-real; {}. Distances × 100, \
             95 % intervals over scenarios, the same draws for all.",
            outcome.of_scenarios(),
            outcome.world,
            outcome.kind,
            if outcome.anchor.is_some() {
                "how far it is from recorded frames stands first"
            } else {
                "no anchor of recorded frames was measured"
            }
        ),
    );
    if outcome.quick {
        m.leaf("p", &[("class", &"warn")], "A quick look: too few scenarios for a judgement.");
    }
    outcome.anchor.iter().for_each(|anchor| anchored(m, anchor));
    looks(m, &outcome.looks);
    findings::write(m, outcome);
    let panel = outcome.policies.values().filter(|table| !table.control).count();
    m.leaf("h2", &[], format_args!("FDπ, the mean over {panel} {}", if panel == 1 { "policy" } else { "policies" }));
    plot(m, outcome);
    let rows: Vec<Vec<String>> =
        outcome.fd_pi.iter().map(|(name, figure)| vec![name.clone(), shown(*figure)]).collect();
    table(m, &["source", "FDπ"], &rows);
    let rows: Vec<Vec<String>> = outcome
        .ratios
        .iter()
        .map(|r| vec![format!("{} / {}", r.above, r.below), r.ratio.map_or_else(|| "–".to_owned(), shown)])
        .collect();
    if !rows.is_empty() {
        table(m, &["ratio", "value"], &rows);
    }
    for (name, found) in &outcome.policies {
        let kind = if found.control { "control, outside the mean" } else { "panel" };
        network(m, &format!("{name}: {kind}"), found);
    }
    for (name, found) in &outcome.others {
        network(m, &format!("{name}: the look network's distance, no FID and no FVD"), found);
    }
    given(m, &outcome.given);
    m.leaf("h2", &[], "Where frames differ");
    m.leaf(
        "p",
        &[],
        "Mean |φ − φ̃|²/Tr Σ × 100 of a scene's frames over the panel. Above the real frame, below the source's.",
    );
    for (source, scenes) in &outcome.worst {
        differ(m, source, scenes);
    }
    attended::write(m, &outcome.attended);
}

fn title(study: &str) -> &'static str {
    match study {
        "correlation" => "Do far sources make bad plans?",
        "sensitivity" => "What distances answer to",
        "rollout" => "Drift along the drive",
        "ablation" => "The video model without its parts",
        "anchor" => "How far from recorded frames?",
        "parts" => "Which part of a frame makes plans differ?",
        _ => "Fidelity of frames for policies",
    }
}

/// Distances from recorded frames.
fn anchored(m: &mut Markup, anchor: &Anchor) {
    let [first, second] = &anchor.unit;
    m.leaf("h2", &[], "Real frames as unit");
    let frames: Vec<String> = anchor.frames.iter().map(|(name, count)| format!("{count} of {name}")).collect();
    m.leaf(
        "p",
        &[],
        format_args!(
            "For the same policies the frames of {second} are 1 from those of {first} ({} frames). Covariances are shrunk, for recorded \
             frames are few; few consecutive frames are no sample of drives, so there are no intervals.",
            frames.join(", ")
        ),
    );
    let from_first = format!("from {first}");
    let value =
        |table: &BTreeMap<String, f64>, name: &str| table.get(name).map_or("–".to_owned(), |v| format!("{v:.2}"));
    let head = ["frames", from_first.as_str(), "from the study's real set"];
    let rows = |of: &BTreeMap<String, f64>, reference: &BTreeMap<String, f64>| -> Vec<Vec<String>> {
        of.keys().map(|name| vec![name.clone(), value(of, name), value(reference, name)]).collect()
    };
    table(m, &head, &rows(&anchor.recorded_to, &anchor.reference_to));
    for (name, found) in &anchor.policies {
        let kind = if found.control { ", control" } else { "" };
        let told =
            format!("{name}{kind}: {} features, drawn to the diagonal by {:.2}", found.features, found.shrinkage);
        m.leaf("h3", &[], told);
        table(m, &head, &rows(&found.recorded_to, &found.reference_to));
    }
}

/// A picture of the folder of scenes with what stands below it.
fn scene(m: &mut Markup, picture: &str, alt: &str, caption: impl std::fmt::Display) {
    m.inside("figure", &[], |m| {
        let path = link(&format!("scenes/{picture}"));
        m.void("img", &[("src", &path), ("alt", &alt), ("loading", &"lazy")]);
        m.leaf("figcaption", &[], caption);
    });
}

/// One moment as every source shows it.
fn looks(m: &mut Markup, looks: &[(String, String)]) {
    m.inside("div", &[("class", &"looks")], |m| {
        for (source, picture) in looks {
            scene(m, picture, source, source);
        }
    });
}

/// A value with its interval, as people read it.
pub(super) fn shown(figure: Figure) -> String {
    format!("{:.2} [{:.2}, {:.2}]", figure.value, figure.low, figure.high)
}

fn network(m: &mut Markup, title: &str, found: &Table) {
    m.leaf("h3", &[], title);
    m.leaf(
        "p",
        &[],
        format_args!(
            "{} frames or clips of {} features; two halves of the real set: {:.2}.",
            found.frames, found.features, found.halves
        ),
    );
    let row = |(name, row): (&String, &Row)| {
        vec![
            name.clone(),
            shown(row.fd),
            format!("{:.2}", row.bias),
            format!("{:.2}", row.extrapolated),
            format!("{:.2}", row.bound),
            row.placed.map_or_else(|| "–".to_owned(), |placed| format!("{placed:.2}")),
            row.warnings.join("; "),
        ]
    };
    let head = ["source", "FD", "b(n)", "at 1/n → 0", "mean of pairs", "placed (ranks only)", "doubts"];
    table(m, &head, &found.sources.iter().map(row).collect::<Vec<_>>());
}

/// FID and FVD by networks that were given.
fn given(m: &mut Markup, found: &BTreeMap<String, Table>) {
    if found.is_empty() {
        return;
    }
    m.leaf("h2", &[], "By the networks given");
    m.leaf(
        "p",
        &[],
        "Fréchet distances in the unit of each network's own features, squared: not over the variance and not × 100, as published \
         ones are. They go with the network, the size of its frames and how they are brought to it, and rise where frames are few.",
    );
    for (name, found) in found {
        network(m, &format!("{} by the network {}", name.to_uppercase(), short(&found.digest, 12)), found);
    }
}

fn differ(m: &mut Markup, source: &str, scenes: &[Scene]) {
    m.leaf("h3", &[], source);
    m.inside("div", &[("class", &"plots")], |m| {
        for found in scenes {
            let Some(picture) = &found.picture else { continue };
            let caption = format_args!("{}: {:.1}, frame {}", found.name, found.apart, found.frame);
            scene(m, picture, picture, caption);
        }
    });
}

/// Dots with bars on a scale of logarithms.
fn plot(m: &mut Markup, outcome: &Outcome) {
    let shown: Vec<(&String, &Figure)> = outcome.fd_pi.iter().filter(|(_, figure)| figure.value > 1e-6).collect();
    if shown.is_empty() {
        return;
    }
    let floor = |figure: &Figure| figure.low.max(0.2 * figure.value);
    let low = shown.iter().map(|(_, figure)| floor(figure)).fold(f64::INFINITY, f64::min).log10().floor();
    let high = shown.iter().map(|(_, figure)| figure.high.max(figure.value)).fold(1e-6, f64::max).log10().ceil();
    let x = |value: f64| 170.0 + 440.0 * (value.log10() - low) / (high - low).max(1.0);
    let height = 40.0 + 26.0 * shown.len() as f64;
    wide(m, "FDπ by source", (640.0, height), |m| {
        #[expect(clippy::cast_possible_truncation, reason = "a few powers of ten")]
        for power in low as i32..=high as i32 {
            let at = x(10f64.powi(power));
            line(m, "axis", (at, 8.0), (at, height - 24.0));
            text(m, "", (at - 8.0, height - 8.0), &format!("{}", 10f64.powi(power)));
        }
        for (row, (name, figure)) in shown.iter().enumerate() {
            let y = 24.0 + 26.0 * row as f64;
            text(m, "", (8.0, y + 4.0), name);
            line(m, "l0", (x(floor(figure)), y), (x(figure.high.max(figure.value)), y));
            dot(m, "b0", (x(figure.value), y), 4.0);
        }
    });
}

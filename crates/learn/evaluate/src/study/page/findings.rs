//! The parts of a page that belong to one study: scatter of distance and plans, answers to edits, drift.

use std::collections::BTreeMap;

use ds_page::Markup;
use ds_page::svg::{area, dot, line, text, wide};

use super::shown;
use crate::estimate::Estimate;
use crate::page::plot::{Line, Plot};
use crate::page::table::table;
use crate::study::outcome::{Correlation, Metric, Outcome, Response, Rollout, Sensitivity};

/// Writes what the study found besides distances.
pub(super) fn write(m: &mut Markup, outcome: &Outcome) {
    if let Some(correlation) = &outcome.correlation {
        correlated(m, correlation);
    }
    if let Some(sensitivity) = &outcome.sensitivity {
        answers(m, sensitivity);
    }
    if let Some(rollout) = &outcome.rollout {
        drift(m, rollout);
    }
}

fn correlated(m: &mut Markup, found: &Correlation) {
    m.leaf("h2", &[], "Do far sources make bad plans?");
    let names = [("fd_pi", "FDπ of the other policies"), ("fd_look", "The look network's distance")];
    for (metric, title) in names {
        if let Some(metric) = found.metrics.get(metric) {
            scatter(m, title, metric);
        }
    }
    m.leaf(
        "p",
        &[],
        format_args!(
            "Each dot is one of {} sources: right is far (logarithms), up is good plans (PDMS of NAVSIM v1.1, open loop, \
             mean over the panel). r is the mean over policies of Pearson's r of a policy's PDMS with the distance itself, \
             not its logarithm; of FDπ the policy's own features are left out.",
            found.sources
        ),
    );
    let number = |value: f64| format!("{value:.2}");
    let row = |(name, metric): (&String, &Metric)| {
        let sources = metric.of_sources.map_or_else(|| "–".to_owned(), |[low, high]| format!("{low:.2} to {high:.2}"));
        let each = metric.each.iter().map(|(policy, r)| format!("{policy} {r:.2}")).collect::<Vec<_>>().join(", ");
        let apart = found.apart.get(name).map_or_else(|| "–".to_owned(), |figure| shown(*figure));
        let [low, high] = metric.without_one;
        vec![
            name.clone(),
            shown(metric.r),
            sources,
            number(metric.spearman),
            format!("{low:.2} to {high:.2}"),
            each,
            apart,
        ]
    };
    let head = [
        "metric",
        "r [scenarios]",
        "as many independent sources",
        "Spearman",
        "one source left out",
        "r of each policy",
        "FDπ's r less this one's",
    ];
    table(m, &head, &found.metrics.iter().map(row).collect::<Vec<_>>());
    let policies: Vec<&String> = found.pdms.keys().collect();
    let Some(first) = found.pdms.values().next() else { return };
    m.leaf("h3", &[], "PDMS by source");
    let row = |source: &String| {
        std::iter::once(source.clone())
            .chain(policies.iter().map(|p| format!("{:.3}", found.pdms[*p][source])))
            .collect()
    };
    let head: Vec<&str> = std::iter::once("source").chain(policies.iter().map(|p| p.as_str())).collect();
    table(m, &head, &first.keys().map(row).collect::<Vec<Vec<String>>>());
}

/// Means over policies, by source.
fn scatter(m: &mut Markup, title: &str, metric: &Metric) {
    let mut sources: BTreeMap<&str, (f64, f64, f64)> = BTreeMap::new();
    for point in &metric.points {
        let sum = sources.entry(&point.source).or_default();
        *sum = (sum.0 + point.distance, sum.1 + point.pdms, sum.2 + 1.0);
    }
    let points: Vec<(&str, f64, f64)> =
        sources.iter().map(|(name, (x, y, count))| (*name, (x / count).max(1e-3).log10(), y / count)).collect();
    let range = |of: &dyn Fn(&(&str, f64, f64)) -> f64| {
        let (low, high) =
            points.iter().map(of).fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        if high > low { (low, high) } else { (low - 0.5, low + 0.5) }
    };
    let ((left, right), (low, high)) = (range(&|p| p.1), range(&|p| p.2));
    let x = |value: f64| 60.0 + 420.0 * (value - left) / (right - left);
    let y = |value: f64| 270.0 - 210.0 * (value - low) / (high - low);
    wide(m, title, (640.0, 310.0), |m| {
        text(m, "title", (8.0, 16.0), &format!("{title}: r {}", shown(metric.r)));
        line(m, "axis", (52.0, 36.0), (52.0, 280.0));
        line(m, "axis", (52.0, 280.0), (620.0, 280.0));
        text(m, "", (4.0, y(high) + 4.0), &format!("{high:.2}"));
        text(m, "", (4.0, y(low) + 4.0), &format!("{low:.2}"));
        text(m, "", (4.0, 36.0), "PDMS");
        text(m, "", (x(left), 298.0), &format!("{:.2}", 10f64.powf(left)));
        text(m, "", (x(right), 298.0), &format!("{:.0} distance × 100", 10f64.powf(right)));
        let mut order: Vec<&(&str, f64, f64)> = points.iter().collect();
        order.sort_by(|a, b| y(a.2).total_cmp(&y(b.2)));
        let mut taken: Vec<(f64, f64)> = Vec::new();
        for (name, at, score) in order {
            let (px, py) = (x(*at), y(*score));
            dot(m, "b0", (px, py), 4.0);
            // Names that would cover each other move down.
            let mut words = py + 4.0;
            while taken.iter().any(|(a, b)| (a - px).abs() < 110.0 && (b - words).abs() < 11.0) {
                words += 11.0;
            }
            taken.push((px, words));
            text(m, "", (px + 7.0, words), name);
        }
    });
}

fn answers(m: &mut Markup, found: &Sensitivity) {
    m.leaf("h2", &[], "How much distances answer to edits of the world");
    for response in &found.responses {
        bars(m, response);
        let unit = if response.in_deviations {
            "The distance of the edited source in deviations of its resamples: the true one is at 0."
        } else {
            "The distance of the edited source over that of the true one, less 1."
        };
        m.leaf("p", &[], unit);
        let row = |(name, answer): (&String, &crate::study::outcome::Answer)| {
            let times = answer.times.map_or_else(|| "–".to_owned(), shown);
            vec![name.clone(), shown(answer.response), times]
        };
        table(
            m,
            &["metric", "answer", "FDπ's answer over this one's"],
            &response.answers.iter().map(row).collect::<Vec<_>>(),
        );
    }
    m.leaf("h2", &[], "Hard scenarios");
    m.leaf(
        "p",
        &[],
        "FDπ on the quarter of the scenarios with most agents near, least time ahead, most turning and most junctions (a \
         score of the scenarios alone), against 200 random quarters; in units of the variance of the whole real set.",
    );
    let row = |hard: &crate::study::outcome::Hard| {
        vec![
            hard.source.clone(),
            format!("{:.2}", hard.value),
            format!("{:.2}", hard.random),
            format!("{:+.0} %", 100.0 * hard.more),
            format!("{:.3}", hard.p),
        ]
    };
    let head = ["source", "hard quarter", "random quarters", "more", "random ones as far"];
    table(m, &head, &found.hard.iter().map(row).collect::<Vec<_>>());
}

fn bars(m: &mut Markup, response: &Response) {
    let title = format!("{} against {}", response.after, response.before);
    let all: Vec<(&String, f64)> = response.answers.iter().map(|(name, a)| (name, a.response.value)).collect();
    let most = all.iter().map(|(_, value)| value.abs()).fold(1e-9, f64::max);
    let least = all.iter().map(|(_, value)| *value).fold(0.0, f64::min);
    let width = |value: f64| 400.0 * value / (most - least);
    let zero = 140.0 - width(least);
    wide(m, &title, (640.0, 34.0 + 22.0 * all.len() as f64), |m| {
        text(m, "title", (8.0, 16.0), &title);
        for (row, (name, value)) in all.iter().enumerate() {
            let y = 26.0 + 22.0 * row as f64;
            text(m, "", (8.0, y + 13.0), name);
            let from = if *value < 0.0 { zero + width(*value) } else { zero };
            area(m, if *name == "fd_pi" { "b1" } else { "b0" }, (from, y), (width(value.abs()), 16.0), "");
            text(m, "", (zero + width(value.max(0.0)) + 6.0, y + 13.0), &format!("{value:.2}"));
        }
        line(m, "axis", (zero, 22.0), (zero, 30.0 + 22.0 * all.len() as f64));
    });
}

fn drift(m: &mut Markup, found: &Rollout) {
    m.leaf("h2", &[], "Along the drive");
    let estimate = |figure: crate::study::outcome::Figure| Estimate {
        value: figure.value,
        low: figure.low,
        high: figure.high,
        samples: 0,
    };
    let lines: Vec<Line<'_>> = found
        .curves
        .iter()
        .map(|curve| {
            let points: Vec<_> = curve.marks.iter().map(|mark| (mark.frame, Some(estimate(mark.fd_pi)))).collect();
            Line::of(&curve.source, &points)
        })
        .collect();
    m.inside("div", &[("class", &"plots")], |m| {
        for pair in lines.chunks(3) {
            Plot { title: "FDπ × 100 over the ten frames up to each mark", lines: pair }.draw(m);
        }
    });
    let Some(first) = found.curves.first() else { return };
    let marks: Vec<String> = first.marks.iter().map(|mark| format!("frame {}", mark.frame)).collect();
    let head: Vec<&str> =
        std::iter::once("source").chain(marks.iter().map(String::as_str)).chain(std::iter::once("rise")).collect();
    let row = |curve: &crate::study::outcome::Curve| {
        let marks = curve.marks.iter().map(|mark| shown(mark.fd_pi));
        std::iter::once(curve.source.clone()).chain(marks).chain(std::iter::once(shown(curve.rise))).collect()
    };
    table(m, &head, &found.curves.iter().map(row).collect::<Vec<Vec<String>>>());
    let row = |removed: &crate::study::outcome::Removed| {
        let share = removed.share.map_or_else(|| "none: the first does not rise".to_owned(), shown);
        vec![removed.without.clone(), removed.with.clone(), share]
    };
    table(
        m,
        &["rises", "rises less", "share of the rise taken away"],
        &found.removed.iter().map(row).collect::<Vec<_>>(),
    );
}

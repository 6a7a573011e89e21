//! Top of the page: what was run, how it ended, the headline with its plot, and where points are lost.
//!
//! Every figure is a headline value (failed drives as 0) unless its column says otherwise.

use std::collections::{BTreeMap, BTreeSet};

use super::markup::Markup;
use super::plot::{self, Dot, MAX_ROWS};
use super::table::{Cell, Heading, Order, table};
use super::{colour_of, group_name};
use crate::aggregate::{Aggregate, Group};
use crate::dimension::Dimension;
use crate::report::Report;
use crate::term;
use crate::write::range;

/// Writes title, what all drives have in common, and the counts.
pub(crate) fn header(m: &mut Markup, report: &Report) {
    m.inside("header", &[], |m| {
        m.inside("div", &[], |m| {
            m.leaf("p", &[("class", &"brand")], "DreamStream report");
            m.leaf("h1", &[], &report.title);
            m.inside("ul", &[("class", &"facts")], |m| {
                for run in &report.runs {
                    fact(m, "run", &format!("{} (version {})", run.name, run.run.version));
                }
                for line in &report.partial {
                    fact(m, "partial", line);
                }
                for (name, value) in &report.constant {
                    let name = if *name == "profile" { "score profile" } else { name };
                    if name != "run" {
                        fact(m, name, value);
                    }
                }
            });
            m.inside("ul", &[("class", &"tiles")], |m| {
                let counts = report.counts;
                for (count, word, alarm) in [
                    (counts.scenarios, "scenarios", false),
                    (counts.episodes, "drives", false),
                    (counts.completed, "completed", false),
                    (counts.failed, "failed", true),
                    (counts.aborted, "aborted", true),
                ] {
                    m.inside("li", &[("class", &if alarm && count > 0 { "alarm" } else { "" })], |m| {
                        m.leaf("b", &[], count);
                        m.leaf("span", &[], word);
                    });
                }
            });
        });
    });
}

fn fact(m: &mut Markup, name: &str, value: &str) {
    m.inside("li", &[], |m| {
        m.leaf("b", &[], name);
        m.leaf("bdi", &[], value);
    });
}

/// Writes the headline table and its plot.
pub(crate) fn headline(m: &mut Markup, report: &Report) {
    let aggregate = &report.headline;
    m.leaf(
        "p",
        &[("class", &"lead")],
        "Route completion times mean score per tick, in points of 100. A failed drive counts 0; an aborted one is left \
         out and counted beside.",
    );
    dots(m, "Driving score by group with 95 % intervals", aggregate);
    let caption = "Headline: mean over scenarios of the mean over drives. “Finished only” leaves failed drives out.";
    totals(m, caption, aggregate);
}

fn dots(m: &mut Markup, title: &str, aggregate: &Aggregate) {
    let score = |group: &Group| group.metric("driving_score").cloned();
    let rows: Vec<Dot> = aggregate
        .groups
        .iter()
        .filter_map(|group| Some((group, score(group)?)))
        .take(MAX_ROWS)
        .map(|(group, score)| Dot {
            label: group_name(&group.key),
            colour: colour_of(&aggregate.by, &group.key, &aggregate.groups),
            headline: score.headline,
            finished: score.finished,
        })
        .collect();
    plot::dots(m, title, &rows);
    m.inside("p", &[("class", &"note")], |m| {
        m.text("Dot and whiskers: headline with its interval. Ring: finished drives only, where it differs.");
        if aggregate.groups.len() > MAX_ROWS {
            m.text(format_args!(" The first {MAX_ROWS} of {} groups; the table has all.", aggregate.groups.len()));
        }
    });
}

/// Writes one row per group with the three totals and the counts.
fn totals(m: &mut Markup, caption: &str, aggregate: &Aggregate) {
    let mut headings: Vec<Heading> = aggregate.by.iter().map(Heading::text).collect();
    headings.extend([
        Heading::number("driving score").hint("failed drives as 0"),
        Heading::number("95 % interval").hint(crate::aggregate::INTERVALS),
        Heading::number("finished only").hint("driving score over completed drives"),
        Heading::number("route completion"),
        Heading::number("mean score").hint("mean of the per-tick score"),
        Heading::number("scenarios"),
        Heading::number("drives"),
        Heading::number("failed"),
        Heading::number("aborted"),
        Heading::number("not applicable").hint("completed drives without a driving score"),
    ]);
    let rows: Vec<Vec<Cell>> = aggregate
        .groups
        .iter()
        .map(|group| {
            let mut row: Vec<Cell> = group.key.iter().map(Cell::name).collect();
            let mean = |name| group.metric(name).and_then(|metric| metric.headline.mean);
            if let Some(score) = group.metric("driving_score") {
                let [value, interval] = Cell::estimate(&score.headline);
                row.extend([value.class("n bar main"), interval, Cell::score(score.finished.mean).class("n")]);
            }
            row.extend([Cell::score(mean("route_completion")), Cell::score(mean("mean_score"))]);
            row.extend([Cell::count(group.counts.scenarios), Cell::count(group.counts.episodes)]);
            row.extend([Cell::alarm(group.counts.failed), Cell::alarm(group.counts.aborted)]);
            row.push(Cell::count(group.metric("driving_score").map_or(0, |score| score.not_applicable)));
            row
        })
        .collect();
    table(m, caption, Order::Fixed, &headings, &rows);
}

/// Writes the stacked bars and the table of sub-metrics.
pub(crate) fn losses(m: &mut Markup, report: &Report) {
    let aggregate = &report.headline;
    let told: Vec<(String, &Group)> = aggregate
        .groups
        .iter()
        .filter(|group| group.lost.is_some())
        .take(MAX_ROWS)
        .map(|group| (group_name(&group.key), group))
        .collect();
    if !told.is_empty() {
        m.leaf(
            "p",
            &[("class", &"lead")],
            "Of 100 points of mean score per tick: what was kept, and what each term took. Route completion is not in it.",
        );
        plot::stacked(m, "Points of the mean score kept and lost per term, by group", &told);
    }
    let terms: Vec<&str> = sub_scores(aggregate);
    if terms.is_empty() {
        return;
    }
    let mut headings: Vec<Heading> = aggregate.by.iter().map(Heading::text).collect();
    headings.extend(terms.iter().map(|term| Heading::number(term::metric_title(term)).hint(term)));
    let rows: Vec<Vec<Cell>> = aggregate
        .groups
        .iter()
        .map(|group| {
            let names = group.key.iter().map(Cell::name);
            names
                .chain(terms.iter().map(|term| Cell::score(group.metric(term).and_then(|t| t.headline.mean))))
                .collect()
        })
        .collect();
    table(
        m,
        "Sub-metrics, means as in the headline; n/a where a term applies to no drive.",
        Order::Fixed,
        &headings,
        &rows,
    );
}

/// Returns the names of the sub-metrics of an aggregate.
pub(crate) fn sub_scores(aggregate: &Aggregate) -> Vec<&str> {
    let first = aggregate.groups.first();
    let names = first.into_iter().flat_map(|group| &group.metrics).map(|metric| metric.metric.as_str());
    names.filter(|name| name.starts_with("sub_scores.")).collect()
}

/// Writes the driving score of every group in every scenario family: groups down, families across.
pub(crate) fn categories(m: &mut Markup, report: &Report) {
    let Some(categories) = &report.categories else { return };
    let Some(place) = categories.by.iter().position(|dimension| *dimension == Dimension::Category) else { return };
    let families: BTreeSet<&String> = categories.groups.iter().map(|group| &group.key[place]).collect();
    let mut rows: BTreeMap<Vec<&String>, BTreeMap<&String, &Group>> = BTreeMap::new();
    for group in &categories.groups {
        let others = group.key.iter().enumerate().filter(|(index, _)| *index != place).map(|(_, value)| value);
        rows.entry(others.collect()).or_default().insert(&group.key[place], group);
    }
    let others = categories.by.iter().filter(|dimension| **dimension != Dimension::Category);
    let mut headings: Vec<Heading> = others.map(Heading::text).collect();
    headings.extend(families.iter().map(|family| Heading::number(if family.is_empty() { "none" } else { family })));
    let rows: Vec<Vec<Cell>> = rows
        .into_iter()
        .map(|(names, by_family)| {
            let names = names.into_iter().map(Cell::name);
            names.chain(families.iter().map(|family| family_cell(by_family.get(family).copied()))).collect()
        })
        .collect();
    let caption = "Driving score per scenario family; point at a cell for its interval and counts.";
    table(m, caption, Order::Sortable, &headings, &rows);
}

fn family_cell(group: Option<&Group>) -> Cell {
    let Some((group, score)) = group.and_then(|group| Some((group, group.metric("driving_score")?))) else {
        return Cell::score(None).hint("no drives");
    };
    let counts = group.counts;
    Cell::score(score.headline.mean).hint(format_args!(
        "95 % interval {}; {} scenarios, {} drives, {} failed, {} aborted",
        range(score.headline.interval),
        counts.scenarios,
        counts.episodes,
        counts.failed,
        counts.aborted
    ))
}

//! Comparisons of runs, bias of the scorer and coverage of the proposals: what differs, and whether that is certain.
//!
//! Dots that are told apart from zero are coloured, the others are grey; tables say the same in words.

use super::group_name;
use super::markup::Markup;
use super::plot::{self, Change};
use super::table::{Cell, Heading, Order, table};
use crate::aggregate::Estimate;
use crate::bias::{Bias, Subject};
use crate::compare::{ComparedGroup, Comparison, Verdict};
use crate::report::Report;
use crate::term;
use crate::write::{chance, points, signed};

/// Writes every comparison of the report.
pub(crate) fn comparisons(m: &mut Markup, report: &Report) {
    for comparison in &report.comparisons {
        m.inside("h3", &[], |m| {
            m.leaf("bdi", &[], &comparison.b);
            m.text(" against ");
            m.leaf("bdi", &[], &comparison.a);
        });
        m.leaf("p", &[("class", &"lead")], "Right of zero, or a positive difference: the first-named run is better.");
        for group in &comparison.groups {
            compared(m, comparison, group);
        }
        for note in &comparison.notes {
            m.leaf("p", &[("class", &"note")], format_args!("Note: {note}."));
        }
        m.leaf("p", &[("class", &"note")], format_args!("Test: {}.", comparison.test));
        unmatched(m, comparison);
    }
}

fn compared(m: &mut Markup, comparison: &Comparison, group: &ComparedGroup) {
    let name = group_name(&group.key);
    let rows: Vec<Change> = group
        .metrics
        .iter()
        .filter(|metric| metric.difference.is_some())
        .map(|metric| Change {
            label: term::metric_title(&metric.metric),
            difference: metric.difference,
            interval: metric.interval,
            certain: metric.verdict == Verdict::Significant,
        })
        .collect();
    plot::changes(m, &format!("Differences per metric, {name}"), &rows);
    let headings = [
        Heading::text("metric"),
        Heading::number(&comparison.a),
        Heading::number(&comparison.b),
        Heading::number("difference"),
        Heading::number("95 % interval"),
        Heading::number("p").hint("of this metric by itself"),
        Heading::number("p (Holm)").hint("corrected for all metrics of the table"),
        Heading::number("scenarios"),
        Heading::number("left out").hint("pairs with an aborted drive / to which the metric does not apply"),
        Heading::text("conclusion"),
    ];
    let rows: Vec<Vec<Cell>> = group
        .metrics
        .iter()
        .map(|metric| {
            let certain = metric.verdict == Verdict::Significant;
            vec![
                Cell::name(term::metric_title(&metric.metric)),
                Cell::score(metric.a),
                Cell::score(metric.b),
                Cell::number(signed(metric.difference), metric.difference),
                Cell::interval(metric.interval, metric.scenarios),
                Cell::number(chance(metric.p), metric.p),
                Cell::number(chance(metric.p_holm), metric.p_holm),
                Cell::count(metric.scenarios),
                Cell::number(format_args!("{} / {}", metric.aborted_pairs, metric.not_applicable_pairs), Some(0.0)),
                Cell::name(metric.verdict.words()).class(if certain { "certain" } else { "" }),
            ]
        })
        .collect();
    let caption = format!("{name}: {} pairs of drives on {} scenarios.", group.pairs, group.scenarios);
    table(m, &caption, Order::Fixed, &headings, &rows);
}

fn unmatched(m: &mut Markup, comparison: &Comparison) {
    if comparison.unmatched.is_empty() {
        return;
    }
    let headings = [
        Heading::text("scenario"),
        Heading::text("set"),
        Heading::text("only in"),
        Heading::number("drives"),
        Heading::text(""),
    ];
    let rows: Vec<Vec<Cell>> = comparison
        .unmatched
        .iter()
        .map(|unmatched| {
            let run = if unmatched.run == "a" { &comparison.a } else { &comparison.b };
            let partly = if unmatched.partly { "other drives of it are paired" } else { "" };
            let names = [&unmatched.scenario, &unmatched.set, run].map(Cell::name);
            names.into_iter().chain([Cell::count(unmatched.episodes), Cell::name(partly)]).collect()
        })
        .collect();
    table(m, "Drives without a partner; they enter no difference.", Order::Sortable, &headings, &rows);
}

/// Writes scorer bias, proposal coverage and the proposals themselves, as far as known.
pub(crate) fn bias(m: &mut Markup, report: &Report) {
    let Some(bias) = &report.bias else { return };
    if !bias.scorer.is_empty() {
        m.leaf("h3", &[], "Scorer bias");
        m.leaf(
            "p",
            &[("class", &"lead")],
            "DS(oracle) − DS(learned) on the same scenarios: what the policy would gain if it ranked its own proposals as \
             the oracle does.",
        );
        let rows = bias.scorer.iter().map(|row| (&row.subject, row.bias));
        drawn(m, "Scorer bias by policy and set", rows.collect());
        scorer_table(m, bias);
    }
    if !bias.coverage.is_empty() {
        m.leaf("h3", &[], "Proposal coverage");
        m.leaf(
            "p",
            &[("class", &"lead")],
            "DS(oracle, changed set) − DS(oracle, base set): what is lost although the ranking is perfect, because no good \
             proposal is there.",
        );
        let estimate = |row: &crate::bias::Coverage| Estimate {
            mean: row.difference,
            interval: row.interval,
            scenarios: row.changed_scenarios,
        };
        drawn(
            m,
            "Proposal coverage by policy and set",
            bias.coverage.iter().map(|row| (&row.subject, estimate(row))).collect(),
        );
        coverage_table(m, bias);
    }
    if !bias.proposals.is_empty() {
        m.leaf("h3", &[], "Proposals");
        proposal_table(m, bias);
    }
}

fn drawn(m: &mut Markup, title: &str, rows: Vec<(&Subject, Estimate)>) {
    let certain = |estimate: &Estimate| estimate.interval.is_some_and(|i| i.low > 0.0 || i.high < 0.0);
    let change = |(subject, estimate): (&Subject, Estimate)| Change {
        label: group_name(&[subject.policy.clone(), subject.set.clone(), subject.scorer.clone()]),
        difference: estimate.mean,
        interval: estimate.interval,
        certain: certain(&estimate),
    };
    plot::changes(m, title, &rows.into_iter().take(plot::MAX_ROWS).map(change).collect::<Vec<_>>());
}

/// What tells the rows of these tables apart: observation and profile only where they vary.
struct Names(Vec<(&'static str, NameOf)>);

type NameOf = fn(&Subject) -> &String;

impl Names {
    fn of<'a>(scorer: &'static str, subjects: impl Iterator<Item = &'a Subject>) -> Self {
        let subjects: Vec<&Subject> = subjects.collect();
        let mut names: Vec<(&'static str, NameOf)> =
            vec![("policy", |s| &s.policy), ("set", |s| &s.set), (scorer, |s| &s.scorer)];
        for (title, name) in [("observation", (|s| &s.observation) as NameOf), ("profile", |s| &s.profile)] {
            if subjects.iter().any(|subject| name(subject) != name(subjects[0])) {
                names.push((title, name));
            }
        }
        Self(names)
    }

    fn headings(&self, numbers: &[(&str, &str)]) -> Vec<Heading> {
        let names = self.0.iter().map(|(title, _)| Heading::text(title));
        names.chain(numbers.iter().map(|(title, hint)| Heading::number(title).hint(hint))).collect()
    }

    fn cells(&self, subject: &Subject) -> Vec<Cell> {
        self.0.iter().map(|(_, name)| Cell::name(name(subject))).collect()
    }
}

fn scorer_table(m: &mut Markup, bias: &Bias) {
    let names = Names::of("oracle", bias.scorer.iter().map(|row| &row.subject));
    let rows: Vec<Vec<Cell>> = bias
        .scorer
        .iter()
        .map(|row| {
            let mut cells = names.cells(&row.subject);
            cells.extend([Cell::score(row.learned), Cell::score(row.oracle)]);
            cells.push(Cell::number(signed(row.bias.mean), row.bias.mean));
            cells.extend([Cell::interval(row.bias.interval, row.bias.scenarios), Cell::count(row.bias.scenarios)]);
            cells.push(Cell::count(row.unmatched));
            cells
        })
        .collect();
    let titles = [
        ("DS learned", "the policy ranks its proposals"),
        ("DS oracle", "the oracle ranks them"),
        ("scorer bias", ""),
        ("95 % interval", "over scenarios"),
        ("scenarios", "driven with both"),
        ("unmatched", "drives with one scorer only"),
    ];
    table(m, "Paired by scenario; failed drives count 0.", Order::Fixed, &names.headings(&titles), &rows);
}

fn coverage_table(m: &mut Markup, bias: &Bias) {
    let names = Names::of("oracle", bias.coverage.iter().map(|row| &row.subject));
    let rows: Vec<Vec<Cell>> = bias
        .coverage
        .iter()
        .map(|row| {
            let mut cells = names.cells(&row.subject);
            cells.extend([Cell::score(row.base), Cell::score(row.changed)]);
            cells.push(Cell::number(signed(row.difference), row.difference));
            cells.push(Cell::interval(row.interval, row.base_scenarios.min(row.changed_scenarios)));
            cells.push(Cell::number(format_args!("{} / {}", row.base_scenarios, row.changed_scenarios), Some(0.0)));
            cells.push(Cell::name(if row.paired { "paired" } else { "unpaired" }).class(""));
            cells
        })
        .collect();
    let base = format!("DS on {}", bias.base_set);
    let titles = [
        (base.as_str(), "the oracle ranks"),
        ("DS on set", "the oracle ranks"),
        ("coverage", ""),
        ("95 % interval", "over scenarios"),
        ("scenarios", "base / changed"),
    ];
    let mut headings = names.headings(&titles);
    headings.push(Heading::text("resampled"));
    table(m, "Paired where every changed scenario is named after a base scenario.", Order::Fixed, &headings, &rows);
}

fn proposal_table(m: &mut Markup, bias: &Bias) {
    let names = Names::of("ranked by", bias.proposals.iter().map(|row| &row.subject));
    let rows: Vec<Vec<Cell>> = bias
        .proposals
        .iter()
        .map(|row| {
            let mut cells = names.cells(&row.subject);
            cells.extend(Cell::estimate(&row.best));
            for share in [&row.bare_ticks, &row.scenarios_with_bare_tick, &row.scenarios_without_positive] {
                let text = share.mean.map_or_else(|| "n/a".to_owned(), |_| format!("{} %", points(share.mean)));
                cells.push(Cell::number(text, share.mean));
                cells.push(Cell::interval(share.interval, share.scenarios));
            }
            cells.push(Cell::count(row.best.scenarios));
            cells
        })
        .collect();
    let titles = [
        ("best proposal", "mean over ticks of the best proposal's score under the oracle"),
        ("95 % interval", "over scenarios"),
        ("bare ticks", "share of ticks at which no proposal scored above 0"),
        ("95 % interval", "over scenarios"),
        ("scenarios with one", "share of scenarios with at least one such tick"),
        ("95 % interval", "over scenarios"),
        ("scenarios without any", "share of scenarios without a positive proposal at any tick"),
        ("95 % interval", "over scenarios"),
        ("scenarios", "with scored proposals"),
    ];
    let caption = "What the oracle says of the proposals. A bare tick is one without any positive proposal.";
    table(m, caption, Order::Fixed, &names.headings(&titles), &rows);
}

//! The table of all scenarios, one row per scenario and group, sortable and filterable.
//!
//! It holds every drive of the report; what the plots cut off is here.

use super::markup::Markup;
use super::overview::sub_scores;
use super::table::{Cell, Heading, Order, table};
use crate::dimension::Dimension;
use crate::report::Report;
use crate::term;

/// Writes the table; dimensions that no row names are left out.
pub(crate) fn section(m: &mut Markup, report: &Report) {
    let aggregate = &report.scenarios;
    let named = |index: usize| aggregate.groups.iter().any(|group| !group.key[index].is_empty());
    let shown: Vec<usize> = (0..aggregate.by.len()).filter(|index| named(*index)).collect();
    let terms = sub_scores(aggregate);
    let mut headings: Vec<Heading> = shown.iter().map(|index| Heading::text(aggregate.by[*index])).collect();
    headings.extend([
        Heading::number("driving score").hint("mean over drives, failed ones as 0"),
        Heading::number("route completion"),
        Heading::number("mean score"),
    ]);
    headings.extend(terms.iter().map(|term| Heading::number(term::metric_title(term)).hint(term)));
    headings.extend(["drives", "failed", "aborted"].map(Heading::number));
    let rows: Vec<Vec<Cell>> = aggregate
        .groups
        .iter()
        .map(|group| {
            let mut row: Vec<Cell> = shown.iter().map(|index| Cell::name(&group.key[*index])).collect();
            let totals = ["driving_score", "route_completion", "mean_score"].into_iter().chain(terms.iter().copied());
            row.extend(totals.map(|name| Cell::score(group.metric(name).and_then(|metric| metric.headline.mean))));
            row.extend([Cell::count(group.counts.episodes), Cell::alarm(group.counts.failed)]);
            row.push(Cell::alarm(group.counts.aborted));
            row
        })
        .collect();
    m.inside("label", &[("class", &"filter"), ("hidden", &"")], |m| {
        m.text("Filter");
        m.void("input", &[("type", &"search"), ("data-table", &"all-scenarios"), ("placeholder", &"words of a row")]);
    });
    m.inside("div", &[("id", &"all-scenarios")], |m| {
        let which = if aggregate.by.contains(&Dimension::Scenario) { "One row per scenario and group." } else { "" };
        let caption = format!("{which} Click a heading to sort; again to reverse, a third time for the first order.");
        table(m, &caption, Order::Sortable, &headings, &rows);
    });
}
